"""Reads columns of a csv table by the names in its header, as text, numbers or stamps.

RobotCar's tables of poses are such files.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Stamps
from pipeline.readers import log

Table = dict[str, tuple[str, ...]]
"""The text in each row (row,), by the name of the column."""


def read_columns(path: Path, names: Sequence[str]) -> Table:
    """The text of the columns `names` (two or more) of a csv.

    Raises LogError naming the missing columns, or a row cut short.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            header = [name.strip() for name in next(rows, [])]
            missing_names = [name for name in names if name not in header]
            if missing_names:
                raise LogError(
                    f"{path}: its first line names no column {', '.join(missing_names)}; fetch the "
                    "file again"
                )
            pick_columns = itemgetter(*(header.index(name) for name in names))
            cells = [pick_columns(row) for row in _whole_rows(path, rows, len(header))]
    except (FileNotFoundError, IsADirectoryError):
        raise LogError(f"{path}: no such file") from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise LogError(f"{path}: expected a csv file; {error}") from None
    if not cells:
        raise LogError(f"{path}: holds no rows")
    return dict(zip(names, zip(*cells, strict=True), strict=True))


def to_numbers(path: Path, table: Table, names: Sequence[str]) -> NDArray[np.float64]:
    """The columns `names` of `table` as numbers (row, name).

    Raises LogError naming the row of `path` that holds another word.
    """
    matrix = np.empty((len(table[names[0]]), len(names)))
    for column, name in enumerate(names):
        values: list[float] = []
        try:
            values.extend(map(float, table[name]))
        except ValueError:  # `values` holds the numbers before the wrong word
            word = table[name][len(values)][:40]
            raise LogError(
                f"{path}: row {len(values) + 1} has {name} {word!r}; expected a number"
            ) from None
        matrix[:, column] = values
    return matrix


def utimes_ns(path: Path, utimes: NDArray[np.float64]) -> Stamps:
    """Stamps (n,) in ns from utimes (n,), stamps in whole µs since 1970.

    Raises LogError naming the first that is no utime or does not increase.
    """
    stamps_ns = log.to_nanoseconds(path, utimes, "µs", 1000)
    bad_rows = np.flatnonzero(stamps_ns % 1000)
    if len(bad_rows):
        row = bad_rows[0]
        raise LogError(f"{path}: row {row + 1} is stamped {utimes[row]:.16g}; expected whole µs")
    return stamps_ns


def _whole_rows(path: Path, rows: Iterable[list[str]], width: int) -> Iterator[list[str]]:
    """Yield all rows but empty lines; raises LogError for a row that has not `width` columns."""
    for number, row in enumerate(filter(None, rows), 1):
        if len(row) != width:
            raise LogError(
                f"{path}: row {number} has {len(row)} columns of {width}; the file is damaged or "
                "cut short"
            )
        yield row
