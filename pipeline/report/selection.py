"""Selections of the table of results: what a figure or a table shows."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

# a number and its 95 % interval, lowest and highest; NaN where there is none
Values = tuple[float, float, float]
NONE: Values = (np.nan, np.nan, np.nan)


def pick(rows: pd.DataFrame, **entries: object) -> pd.DataFrame:
    """The rows with these entries in these columns, in their order."""
    for column, entry in entries.items():
        rows = rows[rows[column] == entry]
    return rows


def values(rows: pd.DataFrame) -> NDArray[np.float64]:
    """Value and interval of each row: (row, 3)."""
    return np.asarray(rows[["value", "low", "high"]], np.float64)


def indexed(rows: pd.DataFrame, *columns: str) -> dict[Any, Values]:
    """Map the entries of some columns to a row's value and interval.

    The key is a tuple, or the entry itself for a single column. Of equal keys the last row wins.
    """
    keys = rows[columns[0]] if len(columns) == 1 else zip(*(rows[c] for c in columns), strict=True)
    return dict(zip(keys, map(tuple, values(rows).tolist()), strict=True))
