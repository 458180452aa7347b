"""The parts by which a paper's finding is judged: numbers of tables, differences, and verdicts.

A `Side` names one number of one model; `Tables` looks it up. The functions make means, differences
and verdicts of such numbers. A difference is taken so that it is above 0 if the paper is right. The
verdict is *shown* if the difference is surely above 0, *contradicted* if it is surely below, else
not decidable. `judging` makes comparisons of these parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.evaluation.rows import HEADING, NOVELTY, PERTURBED, UNPERTURBED, VIEWPOINT
from pipeline.report.comparison import ONE_SEED, Kind
from pipeline.studies.models import ModelName

SHOWN = "shown"
CONTRADICTED = "contradicted"
UNDECIDED = "not decidable here"
UNTRAINED = ("scan_context", "m2dp", "sad")
"""Methods that learn no weights."""
BLACK_ERROR = "black_error"
"""The number that is the error of a black image, in place of a network's reconstruction."""
OF_ALL = "viewpoint of all"
"""`Side.change` of a sequence matched with itself from all headings; VIEWPOINT is from one."""
CLEAR_FACTOR = 1.5
"""Medians of times, which have no interval, differ clearly if they do by this factor."""
SIDE_COLUMNS = ("study", "method", "number", "protocol", "variant", "grid")
"""The columns in which a side names its rows, beside what was asked."""


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
    """The kind of novelty, if the number is of one."""
    change: str = ""
    """The alteration of the queries; empty for queries as driven."""
    level: float | None = 0.0
    """The level of the alteration; None for every level, as for all headings of a sequence that is
    matched with itself."""

    @property
    def is_trained(self) -> bool:
        """Whether it is of a trained network, so that another seed would give another number."""
        return self.method not in UNTRAINED and self.number != BLACK_ERROR

    @property
    def asked(self) -> tuple[str, str]:
        """What its rows have in the columns `ask` and `of`."""
        if self.change in (VIEWPOINT, OF_ALL):
            return VIEWPOINT, HEADING if self.change == VIEWPOINT else ""
        if self.change:
            return PERTURBED, self.change
        return (NOVELTY, self.kind) if self.kind else (UNPERTURBED, "")

    @property
    def model(self) -> str:
        """The model's name, such as sci-4way."""
        return ModelName(self.method, self.variant).name

    @property
    def label(self) -> str:
        """The model, and what is not as usual: altered queries, cells, novelty, answers."""
        if self.number == BLACK_ERROR:
            return "a black image"
        parts = [f"`{self.model}`"]
        if self.change not in ("", VIEWPOINT, OF_ALL):
            parts.append(Kind(self.change, self.level or 0.0).label)
        if self.grid != "10m":
            parts.append(f"{self.grid.removesuffix('m')} m")
        if self.kind:
            parts.append(f"by {self.kind.replace('_', ' ')}")
        if self.number.endswith("25"):
            parts.append("first 25")
        return " ".join(parts)


class Estimate(NamedTuple):
    """A number and the bounds of its 95 % interval; NaN if there is none."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan


NO_ESTIMATE = Estimate()


class Tables:
    """Kept tables by name; `used` are the rows of each that were read so far."""

    def __init__(self, frames: dict[str, pd.DataFrame]) -> None:
        """Take tables of results by name."""
        self.frames = frames
        self.used: dict[str, set[int]] = {name: set() for name in frames}

    def numbers(self, side: Side) -> pd.DataFrame:
        """Value, low and high of a side: a row for each sequence, heading and seed.

        They are means over the repeats. There are no rows if the table, or its rows, are missing.
        """
        frame = self.frames.get(side.table)
        if frame is None:
            return pd.DataFrame(columns=["value", "low", "high"])
        wanted = {name: getattr(side, name) for name in SIDE_COLUMNS}
        wanted |= dict(zip(("ask", "of"), side.asked, strict=True))
        if side.level is not None:
            wanted["at"] = side.level
        chosen = np.logical_and.reduce([frame[name] == value for name, value in wanted.items()])
        rows = frame[chosen & np.isfinite(frame["value"])]
        self.used[side.table] |= set(rows.index)
        headings = rows["at"] if side.change == VIEWPOINT else 0.0 * rows["at"]
        keys = [rows["sequence"], headings.rename("heading"), rows["seed"]]
        return rows.groupby(keys, sort=True)[["value", "low", "high"]].mean()


@dataclass(frozen=True)
class Outcome:
    """What the tables say of a finding."""

    verdict: str
    """SHOWN, CONTRADICTED or UNDECIDED."""
    reason: str
    """Why, as a key of `reasons` in templates/words.yaml."""
    sides: tuple[tuple[Side, Estimate], ...] = ()
    """The sides that were compared, with their numbers."""
    difference: Estimate = NO_ESTIMATE
    """Their difference, above 0 if the paper is right."""
    seeds: int = 0
    """Number of seeds that were compared."""
    pairs: int = 0
    """Number of sequences or headings that were compared."""
    factor: float = 1.0
    """The share of the second side that the first one is compared with."""
    missing: tuple[Side, ...] = ()
    """The sides that the tables lack."""


def missing(*sides: Side) -> Outcome:
    """The outcome without a verdict, since the tables lack these sides."""
    return Outcome(UNDECIDED, "missing", missing=sides)


def mean(numbers: pd.DataFrame) -> Estimate:
    """The mean over sequences, headings and seeds, of the values and of their bounds.

    So the interval is as wide as if the errors of all of them were the same.
    """
    return Estimate(*(float(numbers[name].mean()) for name in ("value", "low", "high")))


def difference_of(estimate: Estimate, other: Estimate, factor: float = 1.0) -> Estimate:
    """One number minus `factor` of another, with an interval from those of the two.

    The squares of the half-widths are added (Zou and Donner, 2008). For two numbers of the same
    queries that is too wide.
    """
    value = estimate.value - factor * other.value
    below = hypot(estimate.value - estimate.low, factor * (other.high - other.value))
    above = hypot(estimate.high - estimate.value, factor * (other.value - other.low))
    return Estimate(value, value - below, value + above)


def common(numbers: pd.DataFrame, other: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The numbers of both sides on the sequences and headings that both have."""
    keys = numbers.index.droplevel("seed")
    other_keys = other.index.droplevel("seed")
    return numbers[keys.isin(other_keys)], other[other_keys.isin(keys)]


def by_interval(
    difference: Estimate, seed_differences: Sequence[float], noise: float = ONE_SEED
) -> tuple[str, str]:
    """Verdict and reason of a difference with an interval.

    It is decided if the interval excludes 0, and if the differences of the seeds all have its sign.
    A single seed must exceed `noise` too: as much as another seed may change.
    """
    value, low, high = difference
    if not (low > 0 or high < 0):
        return UNDECIDED, "across"
    sign = 1 if low > 0 else -1
    least = noise if len(seed_differences) < 2 else 0.0
    if (
        min(sign * value, *(sign * seed_difference for seed_difference in seed_differences))
        <= least
    ):
        return UNDECIDED, "seed"
    return (SHOWN if sign > 0 else CONTRADICTED), "interval"


def everywhere(differences: Sequence[float], noise: float = 0.0) -> tuple[str, str]:
    """Verdict and reason of differences without intervals: all must exceed `noise` on one side."""
    signs = {np.sign(value) if abs(value) > noise else 0.0 for value in differences}
    if signs == {1.0}:
        return SHOWN, "all"
    return (CONTRADICTED, "all") if signs == {-1.0} else (UNDECIDED, "mixed")


def in_order(values: Sequence[float]) -> tuple[str, str]:
    """Verdict and reason of values that should ascend.

    It is contradicted if one is below the one before by a factor of more than CLEAR_FACTOR.
    """
    ratios = np.asarray(values[1:], np.float64) / np.asarray(values[:-1], np.float64)
    if (ratios > 1).all():
        return SHOWN, "order"
    return (CONTRADICTED, "order") if (ratios * CLEAR_FACTOR < 1).any() else (UNDECIDED, "order")
