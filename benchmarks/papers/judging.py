"""Judges a finding of a paper by kept tables of results.

A `Side` names one number of one model; `Tables` looks it up. Each public function is given sides
and returns a `Measure`: a function that reads their numbers in the tables and returns an `Outcome`,
that is the verdict, its reason and the numbers. A difference is taken so that it is above 0 if the
paper is right. The verdict is *shown* if the difference is surely above 0, *contradicted* if it is
surely below, else not decidable. `is_ahead` and `keeps_less` decide by 95 % intervals. The other
functions, whose numbers have no intervals, require all sequences or headings to agree.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.paired import AUC_SHARE_KEPT
from pipeline.evaluation.rows import HEADING, NOVELTY, PERTURBED, UNPERTURBED
from pipeline.report.comparison import ONE_SEED, Kind
from pipeline.studies.models import ModelName

SHOWN = "shown"
CONTRADICTED = "contradicted"
UNDECIDED = "not decidable here"
UNTRAINED = ("scan_context", "m2dp", "sad")
"""Methods that learn no weights."""
BLACK_ERROR = "black_error"
"""The name of the error of a black image, in place of a network's reconstruction."""
CLEAR_FACTOR = 1.5
"""Medians of times, which have no interval, differ clearly if they do by this factor."""
KEPT_WHOLE = 0.9
"""A model that keeps at least this share of a number counts as unharmed."""
FEWEST_SEEDS = 3
"""Fewer seeds say nothing about a spread, nor about one network against another."""
SIDE_COLUMNS = ("study", "method", "number", "protocol", "variant", "grid", "ask", "of")
"""The columns in which a side names its rows; `at` is another, where it is not None."""
Sign = Literal[1, -1]
"""1 if the paper finds the first side above the second, −1 if it finds it below."""


@dataclass(frozen=True)
class Side:
    """One number of one model in one kept table, on all sequences and seeds that it has there.

    `ask`, `of` and `at` are the columns of a table of results; `at` is None for every level, as for
    all headings of a sequence that is matched with itself.
    """

    table: str
    study: str
    method: str
    number: str = "auc_top1"
    protocol: str = "cells"
    variant: str = ""
    grid: str = "10m"
    ask: str = UNPERTURBED
    of: str = ""
    at: float | None = 0.0

    @property
    def is_trained(self) -> bool:
        """Whether its model is a trained network, so that another seed gives another number."""
        return self.method not in UNTRAINED and self.number != BLACK_ERROR

    @property
    def model(self) -> str:
        """The model's name, such as sci-4way."""
        return ModelName(self.method, self.variant).name

    @property
    def label(self) -> str:
        """The model, with its perturbation, cells, novelty and answers if not the usual ones."""
        if self.number == BLACK_ERROR:
            return "a black image"
        parts = [f"`{self.model}`"]
        if self.ask == PERTURBED:
            parts.append(Kind(self.of, self.at or 0.0).label)
        if self.grid != "10m":
            parts.append(f"{self.grid.removesuffix('m')} m")
        if self.ask == NOVELTY:
            parts.append(f"by {self.of.replace('_', ' ')}")
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
    """Kept tables by name; `used` holds the rows of each that were read so far."""

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
        if side.at is not None:
            wanted["at"] = side.at
        chosen = np.logical_and.reduce([frame[name] == value for name, value in wanted.items()])
        rows = frame[chosen & np.isfinite(frame["value"])]
        self.used[side.table] |= set(rows.index)
        headings = rows["at"] if side.of == HEADING else 0.0 * rows["at"]
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


Measure = Callable[[Tables], Outcome]


def _of(sides: Sequence[Side], judge: Callable[..., Outcome]) -> Measure:
    """Judges the numbers of the sides; without a verdict if one of them has none."""

    def measure(tables: Tables) -> Outcome:
        numbers = [tables.numbers(side) for side in sides]
        missing = [side for side, rows in zip(sides, numbers, strict=True) if rows.empty]
        return _missing(*missing) if missing else judge(*numbers)

    return measure


def _missing(*sides: Side) -> Outcome:
    return Outcome(UNDECIDED, "missing", missing=sides)


def is_ahead(
    leader: Side, *rivals: Side, factor: float = 1.0, sign: Sign = 1, noise: float = ONE_SEED
) -> Measure:
    """Claims that one side is above `factor` of the strongest rival; below it if `sign` is −1.

    If both are of one study, they are compared on the sequences that both have.
    """

    def measure(tables: Tables) -> Outcome:
        sides = (leader, *rivals)
        numbers_of = {side: tables.numbers(side) for side in sides}
        missing = [side for side in sides if numbers_of[side].empty]
        if leader in missing or {*rivals} <= {*missing}:
            return _missing(*missing)
        there = [rival for rival in rivals if rival not in missing]
        strongest = max(there, key=lambda rival: _mean(numbers_of[rival]).value)
        numbers, reference = numbers_of[leader], numbers_of[strongest]
        if leader.study == strongest.study:
            numbers, reference = _common(numbers, reference)
            if numbers.empty:
                return _missing(leader, strongest)
        estimate, strongest_estimate = _mean(numbers), _mean(reference)
        difference = difference_of(estimate, strongest_estimate, factor)
        if sign < 0:
            difference = Estimate(-difference.value, -difference.high, -difference.low)
        by_seed = sign * _differences_by_seed(numbers, reference, factor)
        verdict, reason = by_interval(difference, by_seed[np.isfinite(by_seed)].tolist(), noise)
        return Outcome(
            verdict,
            reason,
            sides=((leader, estimate), (strongest, strongest_estimate)),
            difference=difference,
            seeds=_seed_count(numbers),
            pairs=numbers.index.droplevel("seed").nunique(),
            factor=factor,
        )

    return measure


def keeps_less(perturbed: Side, unperturbed: Side, least: float = KEPT_WHOLE) -> Measure:
    """Claims that a model keeps less than the share `least` of its area on perturbed queries.

    It is judged by the share that was computed on the same resamples of the queries
    (AUC_SHARE_KEPT); if the table has none, by the intervals of the two areas.
    """

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(perturbed, unperturbed, factor=least, sign=-1)(tables)
        kept = tables.numbers(replace(perturbed, number=AUC_SHARE_KEPT))
        if outcome.reason == "missing" or kept.empty:
            return outcome
        value, low, high = _mean(kept)
        # Above 0 if less than the share is kept; the bounds change places.
        shortfall = Estimate(least - value, least - high, least - low)
        seed_shortfalls = least - kept["value"].groupby("seed").mean()
        verdict, reason = by_interval(shortfall, seed_shortfalls.tolist())
        reason = "seed" if reason == "seed" else "paired"
        return replace(outcome, verdict=verdict, reason=reason, difference=shortfall)

    return measure


def at_every_heading(
    side: Side,
    other: Side | None,
    sign: Sign = 1,
    within_deg: float = 180.0,
    beyond_deg: float = 0.0,
    limit: float = 0.0,
) -> Measure:
    """Claims that one side is above the other, or above a limit, at every heading.

    If `sign` is −1, it claims that the side is below. The headings are those turned by
    `beyond_deg` to `within_deg`, to either side.
    """

    sides = [side] if other is None else [side, other]

    def judge(*numbers_of_sides: pd.DataFrame) -> Outcome:
        if other is not None:
            numbers_of_sides = _common(*numbers_of_sides)
        numbers_of_sides = tuple(
            _turned(numbers, beyond_deg, within_deg) for numbers in numbers_of_sides
        )
        values = numbers_of_sides[0]["value"].unstack("seed")
        reference: pd.Series | float = limit
        if other is not None:
            reference = numbers_of_sides[1]["value"].groupby(["sequence", "heading"]).mean()
        differences = sign * values.sub(reference, axis=0).to_numpy().ravel()
        differences = differences[np.isfinite(differences)]
        seeds = values.shape[1]
        noise = ONE_SEED if other is not None and seeds == 1 else 0.0
        verdict, reason = _everywhere(differences, noise)
        if verdict != UNDECIDED and other is not None and other.is_trained and seeds < FEWEST_SEEDS:
            # All headings of one training are shifted together: they are no independent evidence.
            verdict, reason = UNDECIDED, "one_training"
        estimates = [_from_to(numbers["value"]) for numbers in numbers_of_sides]
        shown = tuple(zip(sides, estimates, strict=True))
        return Outcome(verdict, reason, shown, seeds=seeds, pairs=len(values))

    return _of(sides, judge)


def is_below(side: Side, limit: float, factor: float = 1.0) -> Measure:
    """Claims that `factor` of one side is below a limit on every sequence and with every seed."""

    def judge(numbers: pd.DataFrame) -> Outcome:
        values = factor * numbers["value"]
        verdict, _ = _everywhere((limit - values).to_numpy())
        shown = ((side, Estimate(float(values.mean()))),)
        return Outcome(verdict, "limit", shown, seeds=_seed_count(numbers), pairs=len(values))

    return _of([side], judge)


def ascend(*sides: Side) -> Measure:
    """Claims that the sides' numbers ascend in this order.

    It is contradicted if one is below the one before by a factor of more than CLEAR_FACTOR.
    """

    def judge(*numbers_of_sides: pd.DataFrame) -> Outcome:
        values = np.array([_mean(numbers).value for numbers in numbers_of_sides])
        ratios = values[1:] / values[:-1]
        verdict = UNDECIDED
        if (ratios > 1).all():
            verdict = SHOWN
        elif (ratios * CLEAR_FACTOR < 1).any():
            verdict = CONTRADICTED
        shown = tuple(zip(sides, map(Estimate, values.tolist()), strict=True))
        seeds = _seed_count(numbers_of_sides[0])
        return Outcome(verdict, "order", shown, seeds=seeds, pairs=len(values))

    return _of(sides, judge)


def spreads_less(side: Side, other: Side) -> Measure:
    """Claims that one side spreads less between seeds than the other, at every heading.

    With fewer than FEWEST_SEEDS seeds it is undecided.
    """

    def judge(*numbers_of_sides: pd.DataFrame) -> Outcome:
        seeds = min(map(_seed_count, numbers_of_sides))
        by_heading = [
            numbers["value"].groupby(["sequence", "heading"]) for numbers in numbers_of_sides
        ]
        verdict, reason = UNDECIDED, "few_seeds"
        values = [headings.mean() for headings in by_heading]
        if seeds >= FEWEST_SEEDS:
            values = [headings.std() for headings in by_heading]
            verdict, reason = _everywhere((values[1] - values[0]).to_numpy())
        shown = tuple(zip((side, other), map(_from_to, values), strict=True))
        return Outcome(verdict, reason, shown, seeds=seeds, pairs=len(values[0]))

    return _of((side, other), judge)


def has_no_verdict(side: Side, other: Side, factor: float = 1.0) -> Measure:
    """Shows the numbers of a finding without a verdict, since its direction is not known here."""

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(side, other, factor=factor)(tables)
        if outcome.reason == "missing":
            return outcome
        return replace(outcome, verdict=UNDECIDED, reason="unknown_direction")

    return measure


def is_not_measured(_: Tables) -> Outcome:
    """The measure of a finding on numbers that no table of results has."""
    return Outcome(UNDECIDED, "absent")


def difference_of(estimate: Estimate, other: Estimate, factor: float = 1.0) -> Estimate:
    """One number minus `factor` of another, with an interval from those of the two.

    The squares of the half-widths are added (Zou and Donner, 2008). For two numbers of the same
    queries that is too wide.
    """
    value = estimate.value - factor * other.value
    below = hypot(estimate.value - estimate.low, factor * (other.high - other.value))
    above = hypot(estimate.high - estimate.value, factor * (other.value - other.low))
    return Estimate(value, value - below, value + above)


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


def _everywhere(differences: Sequence[float], noise: float = 0.0) -> tuple[str, str]:
    """Verdict and reason of differences without intervals: all must exceed `noise` on one side."""
    signs = {np.sign(value) if abs(value) > noise else 0.0 for value in differences}
    if signs == {1.0}:
        return SHOWN, "all"
    return (CONTRADICTED, "all") if signs == {-1.0} else (UNDECIDED, "mixed")


def _mean(numbers: pd.DataFrame) -> Estimate:
    """The mean of values and of bounds: as if the errors of all of them were the same."""
    return Estimate(*(float(numbers[name].mean()) for name in ("value", "low", "high")))


def _common(numbers: pd.DataFrame, other: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The numbers of both sides on the sequences and headings that both have."""
    keys = numbers.index.droplevel("seed")
    other_keys = other.index.droplevel("seed")
    return numbers[keys.isin(other_keys)], other[other_keys.isin(keys)]


def _from_to(values: pd.Series) -> Estimate:
    """The mean, lowest and highest of values, for numbers without an interval."""
    return Estimate(float(values.mean()), float(values.min()), float(values.max()))


def _seed_count(numbers: pd.DataFrame) -> int:
    """The number of seeds that a side has."""
    return int(numbers.index.get_level_values("seed").nunique())


def _differences_by_seed(
    numbers: pd.DataFrame, reference: pd.DataFrame, factor: float
) -> NDArray[np.float64]:
    """The difference for each seed; a single seed is compared with all seeds of the other side."""
    means = numbers["value"].groupby("seed").mean()
    reference_means = reference["value"].groupby("seed").mean()
    seeds = sorted({*means.index, *reference_means.index})
    return _at_seeds(means, seeds) - factor * _at_seeds(reference_means, seeds)


def _at_seeds(means: pd.Series, seeds: Sequence[int]) -> NDArray[np.float64]:
    """A mean for each of the seeds, NaN if there is none; the only one for all of them."""
    if len(means) == 1:
        return np.full(len(seeds), means.iloc[0], np.float64)
    return np.asarray(means.reindex(seeds), np.float64)


def _turned(numbers: pd.DataFrame, beyond_deg: float, within_deg: float) -> pd.DataFrame:
    """The rows whose queries are turned by an angle in this range, to either side."""
    heading_deg = numbers.index.get_level_values("heading").to_numpy(np.float64)
    turn_deg = np.minimum(heading_deg, 360 - heading_deg)
    return numbers[(turn_deg >= beyond_deg) & (turn_deg <= within_deg)]
