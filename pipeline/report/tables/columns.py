"""Columns of numbers, and the cells of results in them: what all modules of tables share."""

from collections.abc import Sequence
from typing import NamedTuple

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.result import Scores
from pipeline.report.selection import Values
from pipeline.report.table import Cell, number, spread

DISTANCE_FIRST = PROTOCOLS[::-1]  # the protocols in the order in which people ask


class Column(NamedTuple):
    """A column of numbers."""

    heading: str
    number: str  # its name in the table of results
    digits: int  # after the point


def headings_of(columns: Sequence[Column]) -> list[str]:
    """The heading of each column."""
    return [column.heading for column in columns]


def bounded(values: Values, digits: int, mark: str = "") -> Cell:
    """A cell of a value with its interval, from (value, lowest, highest)."""
    value, *interval = values
    return number(value, digits, interval, mark)


def bounded_cells(result: Scores, columns: Sequence[Column], protocol: str) -> list[Cell]:
    """The numbers of one result by a protocol with their intervals: one cell per column."""
    return [bounded(result.values(protocol, column.number), column.digits) for column in columns]


def plain_cells(result: Scores, columns: Sequence[Column], protocol: str) -> list[Cell]:
    """The numbers of one result by a protocol without intervals: one cell per column."""
    return [number(result.number(protocol, column.number), column.digits) for column in columns]


def mean_cells(results: Sequence[Scores], columns: Sequence[Column], protocol: str) -> list[Cell]:
    """The mean ± deviation over several results by a protocol: one cell per column."""
    cells = []
    for column in columns:
        values = [result.number(protocol, column.number) for result in results]
        cells.append(spread(values, column.digits))
    return cells
