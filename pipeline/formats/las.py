"""Reads the points of LAS files, and of compressed ones (.laz), through laspy.

A LAS stores whole numbers, with a scale and an offset in its header: their product and sum are
coordinates with the precision of the scale. Classes, colours and returns are left out.
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError, YearlocError, machine_refusal, needed
from pipeline.formats import records
from pipeline.formats.records import PIECE_BYTES, Summary

SIZE = "3 MB"
"""What the extra `las` takes up on disk."""
RECORDS = struct.Struct("<2I")
"""In a header at RECORDS_AT: where the points begin, and the number of records before them."""
RECORDS_AT = 96
FURTHER_RECORDS = struct.Struct("<QI")
"""In a header of version 1.4 at FURTHER_RECORDS_AT: where records after the points begin, and how
many there are."""
FURTHER_RECORDS_AT = 235
RECORD_BYTES = 54
"""The least size of a record."""
TABLE_AT_END = -1
"""The place of the table of chunks if that place is in the last 8 bytes of the file."""
INTERRUPTS = (GeneratorExit, KeyboardInterrupt, SystemExit)


def blocks(path: Path, most_points: int) -> Iterator[NDArray[np.float64]]:
    """The points of a file in blocks (n, 3) of at most `most_points`, in its frame and unit.

    Raises LogError, which names `path`, for a file that is no LAS or is cut short, maybe after some
    blocks, and NotInstalledError without the extra `las`.
    """
    with _opened(path) as reader:
        count = reader.header.point_count
        piece = max(1, PIECE_BYTES // reader.header.point_format.size)
        for first in range(0, count, most_points):
            points = np.empty((min(most_points, count - first), 3))
            for start in range(0, len(points), piece):
                part = points[start : start + piece]
                read = reader.read_points(len(part))
                if len(read) < len(part):
                    raise LogError(
                        f"{path}: {first + start + len(read)} points, {count} by its header; it is "
                        "damaged"
                    )
                with np.errstate(all="ignore"):  # a damaged scale makes infinite coordinates
                    part[:] = np.column_stack([read.x, read.y, read.z])
            yield points


def summary(path: Path) -> Summary:
    """What the header of a file says; raises as `blocks`."""
    with _opened(path) as reader:
        names = [name.lower() for name in reader.header.point_format.dimension_names]
        return Summary(reader.header.point_count, is_float32=False, others=records.others(names))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of the file; what the block raises is raised as LogError."""
    with needed("las", SIZE):
        import laspy
        import lazrs  # noqa: F401, laspy unpacks .laz through it
    _refuse_many_records(path)
    try:
        # the parallel backend takes as much memory as a damaged table of chunks says, or aborts
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:
            _refuse_cut(path, reader.header)
            yield reader
    except (YearlocError, *INTERRUPTS):
        raise
    # A damaged file meets numpy, struct and Rust behind laspy, which raise anything. A panic of
    # Rust is no Exception.
    except BaseException as error:
        if machine_refusal(error):
            raise
        reason = (str(error).splitlines() or [type(error).__name__])[0][:80]
        raise LogError(f"{path}: no readable LAS file ({reason}); save it again") from None


def _refuse_many_records(path: Path) -> None:
    """Raise LogError if the header counts more records than the file holds.

    laspy would read them one by one behind the end of the file, for hours.
    """
    file_bytes = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(FURTHER_RECORDS_AT + FURTHER_RECORDS.size)
    if header[:4] != b"LASF" or len(header) < RECORDS_AT + RECORDS.size:
        raise LogError(f"{path}: no LAS file: it does not begin with 'LASF' and a whole header")
    points_at, count = RECORDS.unpack_from(header, RECORDS_AT)
    is_damaged = points_at > file_bytes or RECORD_BYTES * count > points_at
    if header[24:26] == b"\x01\x04" and len(header) == FURTHER_RECORDS_AT + FURTHER_RECORDS.size:
        further_at, further_count = FURTHER_RECORDS.unpack_from(header, FURTHER_RECORDS_AT)
        is_damaged |= further_count > 0 and further_at + RECORD_BYTES * further_count > file_bytes
    if is_damaged:
        raise LogError(f"{path}: its header counts more records than its {file_bytes} bytes hold")


def _refuse_cut(path: Path, header: Any) -> None:
    """Raise LogError if the file is shorter than the points that its header counts."""
    import lazrs

    file_bytes = path.stat().st_size
    points_at = header.offset_to_point_data
    if not header.are_points_compressed:
        expected_bytes = points_at + header.point_count * header.point_format.size
        if file_bytes < expected_bytes:
            raise LogError(
                f"{path}: {file_bytes} bytes, {expected_bytes} by its header; it is cut short"
            )
        return
    # Compressed points begin with the place of a table of their chunks, and that with a version and
    # the count of chunks, for which lazrs takes memory.
    with path.open("rb") as file:
        file.seek(points_at)
        table_at = int.from_bytes(file.read(8), "little", signed=True)
        if table_at == TABLE_AT_END:
            file.seek(-8, 2)
            table_at = int.from_bytes(file.read(8), "little", signed=True)
        if not points_at < table_at <= file_bytes - 8:
            raise LogError(
                f"{path}: the table of its compressed points is missing; it is cut short"
            )
        file.seek(table_at + 4)
        chunks = int.from_bytes(file.read(4), "little")
        chunk_points = lazrs.LazVlr(header.vlrs.get("LasZipVlr")[0].record_data).chunk_size()
        if chunks > file_bytes or chunks * chunk_points < header.point_count:
            raise LogError(f"{path}: the table of its compressed points is damaged")
