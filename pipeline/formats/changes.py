"""Reads and writes a csv of the changes in a place since training.

A change is a building that is built or demolished, a tree that is planted or felled. Evaluation
splits its results by how near a query is to such a change.
"""

import csv
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from math import isfinite
from pathlib import Path

from pipeline.core.errors import LogError


@dataclass(frozen=True)
class Change:
    """A change in a place: one row of the csv, whose columns are the fields."""

    what: str
    """`construction`, `demolition`, `tree`, or any other kind of change."""
    from_day: int
    """Days after training from which the place looks different; for a construction, when its fence
    is up."""
    day: int
    """Days after training on which the change is complete: the building stands, or is gone."""
    x_m: float
    y_m: float
    """Position in the world frame of the ground truth, as the reader returns it."""


COLUMNS = tuple(field.name for field in fields(Change))


def visible(changes: Iterable[Change], day: int) -> list[Change]:
    """The changes that are visible on `day` but were not on the training day, in order of time."""
    return sorted(
        (change for change in changes if 0 < change.from_day <= day),
        key=lambda change: (change.from_day, change.day, change.x_m, change.y_m),
    )


def write_changes(path: Path, changes: Iterable[Change]) -> None:
    """Write a header and one row per change, with metres to the centimetre."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(COLUMNS)
        for what, from_day, day, x_m, y_m in map(astuple, changes):
            rows.writerow((what, from_day, day, f"{x_m:.2f}", f"{y_m:.2f}"))


def read_changes(path: Path) -> list[Change]:
    """Read a csv, whose columns may come in any order.

    Raises LogError naming the missing columns or the bad row.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            missing_names = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
            if missing_names:
                raise LogError(
                    f"{path}: its first line names no column {', '.join(missing_names)}; expected "
                    f"{','.join(COLUMNS)}"
                )
            return [_change(path, number, row) for number, row in enumerate(rows, 1)]
    except OSError:
        raise LogError(f"{path}: no such file") from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise LogError(f"{path}: expected a csv file; {error}") from None


def _change(path: Path, number: int, row: dict[str, str]) -> Change:
    """The change in row `number` of a csv; raises LogError for other values."""
    what, from_day, day, x_m, y_m = (row[name] for name in COLUMNS)
    change: Change | None
    try:
        change = Change(what, int(from_day), int(day), float(x_m), float(y_m))
    except (TypeError, ValueError):
        change = None
    if change is None or not isfinite(change.x_m + change.y_m):
        raise LogError(
            f"{path}: row {number} holds no change; expected a word, two whole days and x, y in "
            "metres"
        )
    return change
