"""How a finding is judged by kept tables: the comparisons that `claims` are made of.

Each function here returns the one that measures a finding on the tables. Where a number carries no
interval, all sequences or headings must agree.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pandas as pd

from pipeline.evaluation.paired import KEPT
from pipeline.papers.rules import (
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
from pipeline.report.comparison import ONE_SEED

Measure = Callable[[Tables], Outcome]
Sign = Literal[1, -1]
KEPT_WHOLE = 0.9
"""A model that keeps at least this share of a number counts as unharmed."""
FEWEST_SEEDS = 3
"""Fewer seeds tell nothing of a spread, nor of one network against another."""


def is_ahead(
    leader: Side, *rivals: Side, factor: float = 1.0, sign: Sign = 1, noise: float = ONE_SEED
) -> Measure:
    """One side is above `factor` of the strongest other one; below it where `sign` is -1.

    On the sequences that both have, if they are of one study and number.
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
        difference = difference if sign > 0 else _negative(difference)
        verdict, reason = by_interval(difference, _by_seed(numbers, reference, factor, sign), noise)
        sequences = numbers.index.droplevel("seed").nunique()
        sides = ((leader, estimate), (strongest, strongest_estimate))
        return Outcome(verdict, reason, sides, difference, _seeds(numbers), sequences, factor)

    return measure


def keeps_less(altered: Side, driven: Side, least: float = KEPT_WHOLE) -> Measure:
    """A model keeps less than a share of its area on altered queries.

    By the share that is drawn query by query; where the table has none, by two intervals.
    """

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(altered, driven, factor=least, sign=-1)(tables)
        kept = tables.numbers(replace(altered, number=KEPT))
        if outcome.reason == "missing" or kept.empty:
            return outcome
        value, low, high = mean(kept)
        lost = Estimate(least - value, least - high, least - low)
        of_seeds = least - kept["value"].groupby("seed").mean()
        verdict, reason = by_interval(lost, of_seeds.tolist())
        reason = "seed" if reason == "seed" else "paired"
        return replace(outcome, verdict=verdict, reason=reason, difference=lost)

    return measure


def at_every_heading(
    side: Side,
    other: Side | None,
    sign: Sign = 1,
    within_deg: float = 180.0,
    beyond_deg: float = 0.0,
    limit: float = 0.0,
) -> Measure:
    """One side is above the other, or above a limit, at every heading; below it if `sign` is -1.

    Of the headings that are turned by `beyond_deg` to `within_deg` to either side.
    """

    def measure(tables: Tables) -> Outcome:
        sides = [side] if other is None else [side, other]
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        numbers_of_sides = (
            list(common(*numbers_of_sides)) if len(numbers_of_sides) > 1 else numbers_of_sides
        )
        turns_deg = [_turn_deg(numbers) for numbers in numbers_of_sides]
        numbers_of_sides = [
            numbers[(turn_deg >= beyond_deg) & (turn_deg <= within_deg)]
            for numbers, turn_deg in zip(numbers_of_sides, turns_deg, strict=True)
        ]
        values = numbers_of_sides[0]["value"].unstack("seed")
        reference = (
            numbers_of_sides[1]["value"].groupby(["sequence", "heading"]).mean()
            if len(numbers_of_sides) > 1
            else limit
        )
        differences = sign * values.sub(reference, axis=0).to_numpy().ravel()
        differences = differences[np.isfinite(differences)]
        seeds = values.shape[1]
        noise = ONE_SEED if other is not None and seeds == 1 else 0.0
        verdict, reason = everywhere(differences, noise)
        if verdict != UNDECIDED and other is not None and other.is_trained and seeds < FEWEST_SEEDS:
            # a training shifts all of its headings at once
            verdict = UNDECIDED
            reason = "one_training"
        estimates = tuple(
            (each, _from_to(numbers["value"]))
            for each, numbers in zip(sides, numbers_of_sides, strict=True)
        )
        return Outcome(verdict, reason, estimates, seeds=seeds, pairs=len(values))

    return measure


def is_below(side: Side, limit: float, factor: float = 1.0) -> Measure:
    """`factor` of one side is below a limit on every sequence and seed."""

    def measure(tables: Tables) -> Outcome:
        numbers = tables.numbers(side)
        if numbers.empty:
            return missing(side)
        values = factor * numbers["value"]
        verdict, _ = everywhere((limit - values).to_numpy())
        estimate = Estimate(float(values.mean()))
        seeds = _seeds(numbers)
        return Outcome(verdict, "limit", ((side, estimate),), seeds=seeds, pairs=len(values))

    return measure


def ascend(*sides: Side) -> Measure:
    """The sides' numbers ascend in this order."""

    def measure(tables: Tables) -> Outcome:
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        values = [mean(numbers).value for numbers in numbers_of_sides]
        verdict, reason = in_order(values)
        estimates = tuple(zip(sides, map(Estimate, values), strict=True))
        return Outcome(
            verdict, reason, estimates, seeds=_seeds(numbers_of_sides[0]), pairs=len(values)
        )

    return measure


def spreads_less(side: Side, other: Side) -> Measure:
    """One side deviates less between seeds than the other at every heading; takes three seeds."""

    def measure(tables: Tables) -> Outcome:
        sides = (side, other)
        numbers_of_sides = [tables.numbers(each) for each in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        seeds = min(_seeds(numbers) for numbers in numbers_of_sides)
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
    """Numbers of a finding whose direction nobody here knows: there is no verdict."""

    def measure(tables: Tables) -> Outcome:
        outcome = is_ahead(side, other, factor=factor)(tables)
        return (
            outcome
            if outcome.reason == "missing"
            else replace(outcome, verdict=UNDECIDED, reason="untold")
        )

    return measure


def is_not_measured(_: Tables) -> Outcome:
    """A finding that is on numbers which no table of results has."""
    return Outcome(UNDECIDED, "absent")


def _lacking(sides: Sequence[Side], numbers_of_sides: Sequence[pd.DataFrame]) -> list[Side]:
    return [side for side, numbers in zip(sides, numbers_of_sides, strict=True) if numbers.empty]


def _from_to(values: pd.Series) -> Estimate:
    """The mean, the lowest and the highest, for what has no interval."""
    return Estimate(float(values.mean()), float(values.min()), float(values.max()))


def _seeds(numbers: pd.DataFrame) -> int:
    return int(numbers.index.get_level_values("seed").nunique())


def _negative(difference: Estimate) -> Estimate:
    return Estimate(-difference.value, -difference.high, -difference.low)


def _by_seed(
    numbers: pd.DataFrame, reference: pd.DataFrame, factor: float, sign: int
) -> list[float]:
    """The difference of each seed; a side of one seed stands beside every seed of the other."""
    means = [side["value"].groupby("seed").mean() for side in (numbers, reference)]
    seeds = sorted({seed for of_seed in means for seed in of_seed.index})
    of_numbers, of_reference = (
        np.asarray(
            of_seed.reindex(seeds) if len(of_seed) > 1 else np.full(len(seeds), of_seed.iloc[0]),
            np.float64,
        )
        for of_seed in means
    )
    differences = sign * (of_numbers - factor * of_reference)
    return [float(value) for value in differences if np.isfinite(value)]


def _turn_deg(numbers: pd.DataFrame) -> pd.Series:
    """By how many degrees each row's queries are turned, to either side."""
    heading = numbers.index.get_level_values("heading").to_numpy(np.float64)
    return pd.Series(np.minimum(heading, 360 - heading), index=numbers.index)
