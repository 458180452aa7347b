"""How a paper's finding is held against tables of results: what is compared, and three verdicts.

A difference is arranged so that it is above 0 where the paper is right. It is *shown* where the
difference excludes 0 on that side, *contradicted* where it does on the other, else not decidable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.report.comparison import ONE_SEED, Kind
from pipeline.studies.models import ModelName

SHOWN = "shown"
CONTRADICTED = "contradicted"
UNDECIDED = "not decidable here"
UNTRAINED = ("scan_context", "m2dp", "sad")
"""Methods that learn no weights."""
BLACK_ERROR = "black_error"
"""Number of an image that is black everywhere."""
VIEWPOINT = "viewpoint"
OF_ALL = "viewpoint of all"
CLEARLY = 1.5
"""Medians of times without an interval differ clearly by such a factor."""
CHOSEN = ("study", "method", "number", "protocol", "variant", "grid", "kind", "change")
"""Columns that a side has a word for."""


@dataclass(frozen=True)
class Side:
    """One number of one model in one kept table, on all sequences and seeds that it has there."""

    table: str
    study: str
    method: str
    number: str = "auc_top1"
    protocol: str = "cells"
    variant: str = ""
    grid: str = "10m"
    kind: str = ""
    """Of novelty."""
    change: str = ""
    level: float | None = 0.0
    """None: every heading of a sequence that is matched with itself."""

    @property
    def is_trained(self) -> bool:
        """Whether another seed would give another number."""
        return self.method not in UNTRAINED and self.number != BLACK_ERROR

    @property
    def model(self) -> str:
        """The model's name, such as sci-4way."""
        return ModelName(self.method, self.variant).name

    @property
    def label(self) -> str:
        """The model, and what sets it apart: its cells, its answers, what was done to queries."""
        if self.number == BLACK_ERROR:
            return "a black image"
        parts = [f"`{self.model}`"]
        if self.change not in ("", VIEWPOINT, OF_ALL):
            parts.append(Kind(self.change, self.level or 0.0).label)
        parts += [f"{self.grid.removesuffix('m')} m"] if self.grid != "10m" else []
        parts += [f"by {self.kind.replace('_', ' ')}"] if self.kind else []
        parts += ["first 25"] if self.number.endswith("25") else []
        return " ".join(parts)


class Estimate(NamedTuple):
    """A number and the bounds of its 95 % interval, NaN where there is none."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan


NOTHING = Estimate()


class Tables:
    """Kept tables by name; it remembers which of their rows were read."""

    def __init__(self, frames: dict[str, pd.DataFrame]) -> None:
        """Take the tables of results by name."""
        self.frames = frames
        self.used: dict[str, set[int]] = {name: set() for name in frames}

    def numbers(self, side: Side) -> pd.DataFrame:
        """Value, low and high of a side, means over the repeats.

        A row for each sequence, heading and seed; none where the table, or its rows, are missing.
        """
        frame = self.frames.get(side.table)
        if frame is None:
            return pd.DataFrame(columns=["value", "low", "high"])
        wanted = {"stress": "", "shadow": False} | {name: getattr(side, name) for name in CHOSEN}
        if side.level is not None:
            wanted["level"] = side.level
        chosen = np.logical_and.reduce([frame[name] == value for name, value in wanted.items()])
        rows = frame[chosen & np.isfinite(frame["value"])]
        self.used[side.table] |= set(rows.index)
        headings = rows["level"] if side.change == VIEWPOINT else 0.0 * rows["level"]
        keys = [rows["sequence"], headings.rename("heading"), rows["seed"]]
        return rows.groupby(keys, sort=True)[["value", "low", "high"]].mean()


@dataclass(frozen=True)
class Outcome:
    """What the tables say of a finding."""

    verdict: str
    reason: str
    """Its key in templates/words.yaml."""
    sides: tuple[tuple[Side, Estimate], ...] = ()
    difference: Estimate = NOTHING
    seeds: int = 0
    pairs: int = 0
    """Sequences or headings."""
    factor: float = 1.0
    """Of the second side, that the first is held against."""
    missing: tuple[Side, ...] = ()


def missing(*sides: Side) -> Outcome:
    """No verdict: the tables lack what it takes."""
    return Outcome(UNDECIDED, "missing", missing=sides)


def mean(numbers: pd.DataFrame) -> Estimate:
    """The mean over sequences, headings and seeds, with the mean of the bounds.

    So the interval is as wide as if all of them erred alike.
    """
    return Estimate(*(float(numbers[name].mean()) for name in ("value", "low", "high")))


def difference_of(estimate: Estimate, other: Estimate, factor: float = 1.0) -> Estimate:
    """One number less `factor` of another, with an interval from those of the two.

    Half-widths add as squares do (Zou and Donner, 2008), which is too wide where both numbers are
    of the same queries.
    """
    value = estimate.value - factor * other.value
    below = hypot(estimate.value - estimate.low, factor * (other.high - other.value))
    above = hypot(estimate.high - estimate.value, factor * (other.value - other.low))
    return Estimate(value, value - below, value + above)


def common(numbers: pd.DataFrame, other: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Both, on the sequences and headings that both have."""
    keys = numbers.index.droplevel("seed")
    other_keys = other.index.droplevel("seed")
    return numbers[keys.isin(other_keys)], other[other_keys.isin(keys)]


def by_interval(
    difference: Estimate, of_seeds: Sequence[float], noise: float = ONE_SEED
) -> tuple[str, str]:
    """Verdict and reason of a difference with an interval.

    It is clear if the interval and all seeds exclude 0; one seed must exclude `noise` as well.
    """
    value, low, high = difference
    if not (low > 0 or high < 0):
        return UNDECIDED, "across"
    sign = 1 if low > 0 else -1
    least = noise if len(of_seeds) < 2 else 0.0
    if min(sign * value, *(sign * of_seed for of_seed in of_seeds)) <= least:
        return UNDECIDED, "seed"
    return (SHOWN if sign > 0 else CONTRADICTED), "interval"


def everywhere(differences: Sequence[float], noise: float = 0.0) -> tuple[str, str]:
    """Verdict and reason of differences without intervals: all must exclude `noise` on one side."""
    signs = {np.sign(value) if abs(value) > noise else 0.0 for value in differences}
    if signs == {1.0}:
        return SHOWN, "all"
    return (CONTRADICTED, "all") if signs == {-1.0} else (UNDECIDED, "mixed")


def in_order(values: Sequence[float]) -> tuple[str, str]:
    """Verdict and reason of values that should ascend.

    Contradicted where one is clearly below the one before: by a factor of CLEARLY.
    """
    ratios = np.asarray(values[1:], np.float64) / np.asarray(values[:-1], np.float64)
    if (ratios > 1).all():
        return SHOWN, "order"
    return (CONTRADICTED, "order") if (ratios * CLEARLY < 1).any() else (UNDECIDED, "order")
