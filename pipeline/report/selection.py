"""Selects rows and numbers of the table of results, for figures, tables and findings.

A row of that table is one number: of which model, on which sequence, in which case of its queries,
by which protocol, with its value and its 95 % interval.
"""

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

# a number and its 95 % interval, lowest and highest; NaN where there is none
Values = tuple[float, float, float]
NONE: Values = (np.nan, np.nan, np.nan)
Item = TypeVar("Item")


def pick(rows: pd.DataFrame, **entries: object) -> pd.DataFrame:
    """The rows that have these entries in these columns, in the order of the table."""
    for column, entry in entries.items():
        rows = rows[rows[column] == entry]
    return rows


def is_posed(model: str) -> bool:
    """Whether a model, such as `sci-4way-pose`, answers with poses, by its name."""
    return "pose" in model.split("-")


def values(rows: pd.DataFrame) -> NDArray[np.float64]:
    """Value and interval of each row: (row, 3)."""
    return np.asarray(rows[["value", "low", "high"]], np.float64)


def indexed(rows: pd.DataFrame, *columns: str) -> dict[Any, Values]:
    """Map the entries of some columns to the value and interval of their row.

    A key is a tuple, or the entry itself for a single column. Where rows have equal keys the last
    one counts.
    """
    keys = rows[columns[0]] if len(columns) == 1 else zip(*(rows[c] for c in columns), strict=True)
    return dict(zip(keys, map(tuple, values(rows).tolist()), strict=True))


def grouped(items: Iterable[Item], attribute: str) -> dict[str, list[Item]]:
    """Group scores or strategies by one of their attributes; groups and items keep their order."""
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(getattr(item, attribute), []).append(item)
    return groups
