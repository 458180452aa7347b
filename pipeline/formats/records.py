"""Reads points block by block from records or from lines of numbers, as PCD and PLY have them.

Only one block is in memory at a time, so a file may be larger than the memory.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError

AXES = ("x", "y", "z")
HEADER_BYTES = 65_536
"""Limit for a header, which usually has a few hundred bytes."""
PIECE_BYTES = 2**24
"""Bytes of records that are read at once."""
LONGEST_LINE = 2**16
"""Limit for a line of numbers."""


@dataclass(frozen=True)
class Summary:
    """What the header of a file of points says."""

    points: int
    """Number of points."""
    is_float32: bool
    """Whether a coordinate is stored as a 32-bit float."""
    faces: int = 0
    """Number of faces of a mesh; 0 for a cloud."""
    others: tuple[str, ...] = ()
    """Names of what a point has beside x, y and z, such as intensity."""


@dataclass(frozen=True)
class Column:
    """Where the numbers of one axis are in the bytes of all points."""

    dtype: str
    """The type of a number as numpy names it, such as <f4."""
    offset_bytes: int
    """The first number's first byte."""
    step_bytes: int
    """From a point's number to that of the next point."""


def refuse_other_fields(path: Path, fields: Sequence[str]) -> None:
    """Raise LogError unless x, y and z are among the names of the fields, once each."""
    if all(fields.count(axis) == 1 for axis in AXES):
        return
    is_flat = "z" not in fields and {"x", "y"} <= set(fields)
    advice = "; a level map is the .yaml of Nav2: `yearloc pack --map hall.yaml`" if is_flat else ""
    raise LogError(
        f"{path}: its fields are {' '.join(fields)}; expected x, y and z, once each{advice}"
    )


def others(fields: Sequence[str]) -> tuple[str, ...]:
    """The names of the fields beside x, y and z."""
    return tuple(name for name in fields if name not in AXES)


def is_float32(columns: Sequence[Column]) -> bool:
    """Whether a coordinate is stored as a 32-bit float."""
    return any(column.dtype.endswith("f4") for column in columns)


def fill(
    points: NDArray[np.float64],
    data: bytes | NDArray[np.uint8],
    columns: Sequence[Column],
    first: int = 0,
) -> None:
    """Write the numbers of the columns into points (n, 3): those of `data` from index `first`."""
    with np.errstate(invalid="ignore"):  # numpy warns when a signalling NaN becomes a float64
        for axis, column in enumerate(columns):
            points[:, axis] = np.ndarray(
                len(points),
                column.dtype,
                buffer=data,
                offset=column.offset_bytes + first * column.step_bytes,
                strides=(column.step_bytes,),
            )


def from_records(
    file: BinaryIO, path: Path, columns: Sequence[Column], count: int, most_points: int
) -> Iterator[NDArray[np.float64]]:
    """Blocks (n, 3) of at most `most_points` points, from records that begin where `file` is.

    The step of all columns is the size of a record. Raises LogError, which names `path`, if the
    file ends before `count` points.
    """
    record_bytes = columns[0].step_bytes
    piece = max(1, PIECE_BYTES // record_bytes)
    for first in range(0, count, most_points):
        points = np.empty((min(most_points, count - first), 3))
        for start in range(0, len(points), piece):
            part = points[start : start + piece]
            data = file.read(len(part) * record_bytes)
            if len(data) < len(part) * record_bytes:
                raise LogError(f"{path}: it became shorter while it was read; read it again")
            fill(part, data, columns)
        yield points


def lines(file: BinaryIO) -> Iterator[str]:
    """The lines of a text from where `file` is, without empty ones."""
    while data := file.readline(LONGEST_LINE):
        line = data.decode("ascii", "replace").strip()
        if line:
            yield line


def from_lines(
    rows: Iterator[str],
    path: Path,
    columns: Sequence[int],
    column_count: int,
    count: int,
    most_points: int,
) -> Iterator[NDArray[np.float64]]:
    """Blocks (n, 3) of at most `most_points` points, from the next `count` lines of numbers.

    `columns` are the indices of x, y and z among the `column_count` numbers of a line. Raises
    LogError, which names `path`, for a line of anything else and for too few lines.
    """
    for first in range(0, count, most_points):
        expected = min(most_points, count - first)
        line = next(rows, None)
        if line is None:
            _refuse_lines(path, first, count)
        try:
            numbers = np.loadtxt(
                chain([line], islice(rows, expected - 1)), ndmin=2, comments=None, encoding="ascii"
            )
        except ValueError as error:
            raise LogError(
                f"{path}: points are lines of {column_count} numbers; {str(error).splitlines()[0]}"
            ) from None
        if len(numbers) < expected:
            _refuse_lines(path, first + len(numbers), count)
        if numbers.shape[1] != column_count:
            raise LogError(
                f"{path}: a point has {numbers.shape[1]} numbers, {column_count} by its header"
            )
        yield numbers[:, columns]


def refuse_more_lines(rows: Iterator[str], path: Path, count: int) -> None:
    """Raise LogError if lines follow those of the `count` points of the header."""
    more = sum(1 for _ in rows)
    if more:
        _refuse_lines(path, count + more, count)


def _refuse_lines(path: Path, found: int, count: int) -> NoReturn:
    raise LogError(
        f"{path}: {found} lines of points for the {count} points of its header; it is damaged"
    )
