"""Reads the points of LAS files, and of compressed ones (.laz), through laspy.

A LAS stores whole numbers, with a scale and an offset in its header: their product and sum are
coordinates with the precision of the scale. Classes, colours and returns are left out.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError, YearlocError, machine_refusal, needed
from pipeline.formats.records import Summary

SIZE = "3 MB"
"""What the extra `las` takes up on disk."""


def blocks(path: Path, most_points: int) -> Iterator[NDArray[np.float64]]:
    """The points of a file in blocks (n, 3) of at most `most_points`, in its frame and unit.

    Raises LogError, which names `path`, for a file that is no LAS or is cut short, maybe after some
    blocks, and NotInstalledError without the extra `las`.
    """
    with _opened(path) as reader:
        count = 0
        for chunk in reader.chunk_iterator(most_points):
            count += len(chunk)
            yield np.column_stack([chunk.x, chunk.y, chunk.z]).astype(np.float64, copy=False)
        if count != reader.header.point_count:
            raise LogError(
                f"{path}: {count} points, {reader.header.point_count} by its header; it is damaged"
            )


def summary(path: Path) -> Summary:
    """What the header of a file says; raises as `blocks`."""
    with _opened(path) as reader:
        return Summary(reader.header.point_count, is_float32=False)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of the file; what the block raises is raised as LogError."""
    with needed("las", SIZE):
        import laspy
        import lazrs  # noqa: F401, laspy unpacks .laz through it
    try:
        with laspy.open(path) as reader:
            _refuse_cut(path, reader.header)
            yield reader
    except YearlocError:
        raise
    # a damaged file meets numpy, struct and Rust behind laspy, which raise anything
    except Exception as error:
        if machine_refusal(error):
            raise
        reason = (str(error).splitlines() or [type(error).__name__])[0][:80]
        raise LogError(f"{path}: no readable LAS file ({reason}); save it again") from None


def _refuse_cut(path: Path, header: Any) -> None:
    """Raise LogError if the file is shorter than the points that its header counts."""
    expected_bytes = header.offset_to_point_data
    if not header.are_points_compressed:
        expected_bytes += header.point_count * header.point_format.size
    found_bytes = path.stat().st_size
    if found_bytes < expected_bytes:
        raise LogError(
            f"{path}: {found_bytes} bytes, {expected_bytes} by its header; it is cut short"
        )
