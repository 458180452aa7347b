"""How a finding is judged by tables of results: the comparisons that `claims` are made of.

Each public function here is given sides (numbers of models) and returns a `Measure`: a function
that reads these numbers in the tables and returns an `Outcome`, that is the verdict, its reason and
the numbers. `is_ahead` and `keeps_less` decide by 95 % intervals; the others, whose numbers have
none, ask all sequences or headings to agree.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.papers.rules import (
    UNDECIDED,
    Estimate,
    Outcome,
    Side,
    Tables,
    by_interval,
    common,
    difference_of,
    everywhere,
    in_order,
    mean,
    missing,
)
from pipeline.evaluation.paired import KEPT
from pipeline.report.comparison import ONE_SEED

Measure = Callable[[Tables], Outcome]
Sign = Literal[1, -1]
"""1 where the paper finds the first side above the second, −1 where it finds it below."""
KEPT_WHOLE = 0.9
"""A model that keeps at least this share of a number counts as unharmed."""
FEWEST_SEEDS = 3
"""Fewer seeds say nothing about a spread, nor about one network against another."""


def is_ahead(
    leader: Side, *rivals: Side, factor: float = 1.0, sign: Sign = 1, noise: float = ONE_SEED
) -> Measure:
    """Claims that one side is above `factor` of the strongest rival; below it if `sign` is −1.

    If both are of one study, they are compared on the sequences that both have.
    """

    def measure(tables: Tables) -> Outcome:
        numbers = tables.numbers(leader)
        numbers_of_rivals = {rival: tables.numbers(rival) for rival in rivals}
        lacking = _lacking((leader, *rivals), (numbers, *numbers_of_rivals.values()))
        if numbers.empty or set(lacking) >= set(rivals):
            return missing(*lacking)
        strongest = max(
            (rival for rival in rivals if rival not in lacking),
            key=lambda rival: mean(numbers_of_rivals[rival]).value,
        )
        reference = numbers_of_rivals[strongest]
        if leader.study == strongest.study:
            numbers, reference = common(numbers, reference)
            if numbers.empty:
                return missing(leader, strongest)
        estimate = mean(numbers)
        strongest_estimate = mean(reference)
        difference = difference_of(estimate, strongest_estimate, factor)
        if sign < 0:
            difference = _negative(difference)
        seed_differences = _differences_by_seed(numbers, reference, factor, sign)
        verdict, reason = by_interval(difference, seed_differences, noise)
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


def keeps_less(altered: Side, driven: Side, least: float = KEPT_WHOLE) -> Measure:
    """Claims that a model keeps less than the share `least` of its area on altered queries.

    It is judged by the share that was computed on the same resamples of the queries (KEPT); if the
    table has none, by the intervals of the two areas.
    """

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(altered, driven, factor=least, sign=-1)(tables)
        kept = tables.numbers(replace(altered, number=KEPT))
        if outcome.reason == "missing" or kept.empty:
            return outcome
        value, low, high = mean(kept)
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

    If `sign` is −1, that it is below. The headings are those turned by `beyond_deg` to
    `within_deg`, to either side.
    """

    def measure(tables: Tables) -> Outcome:
        sides = [side] if other is None else [side, other]
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        if other is not None:
            numbers_of_sides = list(common(*numbers_of_sides))
        numbers_of_sides = [
            _turned(numbers, beyond_deg, within_deg) for numbers in numbers_of_sides
        ]
        values = numbers_of_sides[0]["value"].unstack("seed")
        reference: pd.Series | float = limit
        if other is not None:
            reference = numbers_of_sides[1]["value"].groupby(["sequence", "heading"]).mean()
        differences = sign * values.sub(reference, axis=0).to_numpy().ravel()
        differences = differences[np.isfinite(differences)]
        seeds = values.shape[1]
        noise = ONE_SEED if other is not None and seeds == 1 else 0.0
        verdict, reason = everywhere(differences, noise)
        if verdict != UNDECIDED and other is not None and other.is_trained and seeds < FEWEST_SEEDS:
            # All headings of a training are shifted alike, so they are no independent evidence.
            verdict = UNDECIDED
            reason = "one_training"
        estimates = tuple(
            (each, _from_to(numbers["value"]))
            for each, numbers in zip(sides, numbers_of_sides, strict=True)
        )
        return Outcome(verdict, reason, estimates, seeds=seeds, pairs=len(values))

    return measure


def is_below(side: Side, limit: float, factor: float = 1.0) -> Measure:
    """Claims that `factor` of one side is below a limit on every sequence and with every seed."""

    def measure(tables: Tables) -> Outcome:
        numbers = tables.numbers(side)
        if numbers.empty:
            return missing(side)
        values = factor * numbers["value"]
        verdict, _ = everywhere((limit - values).to_numpy())
        estimate = Estimate(float(values.mean()))
        seeds = _seed_count(numbers)
        return Outcome(verdict, "limit", ((side, estimate),), seeds=seeds, pairs=len(values))

    return measure


def ascend(*sides: Side) -> Measure:
    """Claims that the sides' numbers ascend in this order."""

    def measure(tables: Tables) -> Outcome:
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        values = [mean(numbers).value for numbers in numbers_of_sides]
        verdict, reason = in_order(values)
        estimates = tuple(zip(sides, map(Estimate, values), strict=True))
        return Outcome(
            verdict, reason, estimates, seeds=_seed_count(numbers_of_sides[0]), pairs=len(values)
        )

    return measure


def spreads_less(side: Side, other: Side) -> Measure:
    """Claims that one side spreads less between seeds than the other, at every heading.

    With fewer than FEWEST_SEEDS seeds it is undecided.
    """

    def measure(tables: Tables) -> Outcome:
        sides = (side, other)
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        seeds = min(_seed_count(numbers) for numbers in numbers_of_sides)
        by_heading = [
            numbers["value"].groupby(["sequence", "heading"]) for numbers in numbers_of_sides
        ]
        if seeds < FEWEST_SEEDS:
            means = [values.mean() for values in by_heading]
            estimates = tuple(zip(sides, map(_from_to, means), strict=True))
            return Outcome(UNDECIDED, "few_seeds", estimates, seeds=seeds, pairs=len(means[0]))
        spreads = [values.std() for values in by_heading]
        verdict, reason = everywhere((spreads[1] - spreads[0]).to_numpy())
        estimates = tuple(zip(sides, map(_from_to, spreads), strict=True))
        return Outcome(verdict, reason, estimates, seeds=seeds, pairs=len(spreads[0]))

    return measure


def has_no_verdict(side: Side, other: Side, factor: float = 1.0) -> Measure:
    """Shows the numbers of a finding without a verdict, since its direction is not known here."""

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(side, other, factor=factor)(tables)
        if outcome.reason == "missing":
            return outcome
        return replace(outcome, verdict=UNDECIDED, reason="untold")

    return measure


def is_not_measured(_: Tables) -> Outcome:
    """The measure of a finding on numbers that no table of results has."""
    return Outcome(UNDECIDED, "absent")


def _lacking(sides: Sequence[Side], numbers_of_sides: Sequence[pd.DataFrame]) -> list[Side]:
    """The sides without any number in the tables."""
    return [side for side, numbers in zip(sides, numbers_of_sides, strict=True) if numbers.empty]


def _from_to(values: pd.Series) -> Estimate:
    """The mean, lowest and highest of values, for numbers without an interval."""
    return Estimate(float(values.mean()), float(values.min()), float(values.max()))


def _seed_count(numbers: pd.DataFrame) -> int:
    """The number of seeds that a side has."""
    return int(numbers.index.get_level_values("seed").nunique())


def _negative(difference: Estimate) -> Estimate:
    """The difference the other way round."""
    return Estimate(-difference.value, -difference.high, -difference.low)


def _differences_by_seed(
    numbers: pd.DataFrame, reference: pd.DataFrame, factor: float, sign: int
) -> list[float]:
    """The difference for each seed; a single seed is compared with all seeds of the other side."""
    means = numbers["value"].groupby("seed").mean()
    reference_means = reference["value"].groupby("seed").mean()
    seeds = sorted({*means.index, *reference_means.index})
    values = _at_seeds(means, seeds) - factor * _at_seeds(reference_means, seeds)
    return [float(value) for value in sign * values if np.isfinite(value)]


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
