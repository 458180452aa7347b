"""What the two papers claim, as comparisons of numbers in kept tables of results.

The words stand in templates/words.yaml, under the same names. Tables: `nway`, SCI in full with N
headings; `street`, bird-views of a street; `compare`, all methods; `real`, recordings.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.evaluation.paired import KEPT
from pipeline.papers.rules import (
    OF_ALL,
    UNDECIDED,
    UNTRAINED,
    VIEWPOINT,
    Estimate,
    Outcome,
    Side,
    Tables,
    by_interval,
    common,
    everywhere,
    in_order,
    less,
    mean,
    missing,
)
from pipeline.report.comparison import ONE_SEED

MOST = 0.9
"""Who keeps this share of a number has kept it: a finding that something costs nothing, or all, is
held against nine tenths."""
HALF = 0.5
KB = 1024.0
CODES = 8  # of a place, one a heading
FEWEST_SEEDS = 3  # that a spread is told of
CODE_B = 1.05 * KB  # with what else a place takes
SCAN_MS = 100.0  # between two scans at 10 Hz
DESCRIPTORS = ("scan_context", "m2dp", "pointnetvlad")


@dataclass(frozen=True)
class Claim:
    """A finding of a paper, by its name in templates/words.yaml, and how the tables judge it."""

    name: str
    paper: int
    measure: Callable[[Tables], Outcome]
    digits: int = 3


def ahead(
    leader: Side, *rivals: Side, factor: float = 1.0, sign: int = 1, noise: float = ONE_SEED
) -> Callable[[Tables], Outcome]:
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
        difference = less(estimate, strongest_estimate, factor)
        difference = difference if sign > 0 else _negative(difference)
        verdict, reason = by_interval(difference, _by_seed(numbers, reference, factor, sign), noise)
        sequences = numbers.index.droplevel("seed").nunique()
        sides = ((leader, estimate), (strongest, strongest_estimate))
        return Outcome(verdict, reason, sides, difference, _seeds(numbers), sequences, factor)

    return measure


def keeps_less(altered: Side, driven: Side, least: float = MOST) -> Callable[[Tables], Outcome]:
    """A model keeps less than a share of its area on altered queries.

    By the share that is drawn query by query; where the table has none, by two intervals.
    """

    def measure(tables: Tables) -> Outcome:
        outcome = ahead(altered, driven, factor=least, sign=-1)(tables)
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
    sign: int = 1,
    within_deg: float = 180.0,
    beyond_deg: float = 0.0,
    limit: float = 0.0,
) -> Callable[[Tables], Outcome]:
    """One side is above the other, or above a limit, at every heading; below it if `sign` is -1.

    Of the headings that are turned by `beyond_deg` to `within_deg` to either side.
    """

    def measure(tables: Tables) -> Outcome:
        sides = [side] if other is None else [side, other]
        numbers_of_sides = [tables.numbers(side) for side in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        numbers_of_sides = (
            list(common(*numbers_of_sides)) if len(numbers_of_sides) > 1 else numbers_of_sides
        )
        turned = [_turned(numbers) for numbers in numbers_of_sides]
        numbers_of_sides = [
            numbers[(angle >= beyond_deg) & (angle <= within_deg)]
            for numbers, angle in zip(numbers_of_sides, turned, strict=True)
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
        is_network = (
            other is not None
            and other.method not in UNTRAINED
            and other.number != BLACK_ERROR.number
        )
        if verdict != UNDECIDED and is_network and seeds < FEWEST_SEEDS:
            # a training shifts all of its headings at once
            verdict, reason = UNDECIDED, "one_training"
        estimates = tuple(
            (side, _from_to(numbers["value"]))
            for side, numbers in zip(sides, numbers_of_sides, strict=True)
        )
        return Outcome(verdict, reason, estimates, seeds=seeds, pairs=len(values))

    return measure


def below(side: Side, limit: float, factor: float = 1.0) -> Callable[[Tables], Outcome]:
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


def ordered(*sides: Side) -> Callable[[Tables], Outcome]:
    """The sides' numbers ascend in this order."""

    def measure(tables: Tables) -> Outcome:
        numbers_of_sides = [tables.numbers(side) for side in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        values = [mean(numbers).value for numbers in numbers_of_sides]
        verdict, reason = in_order(values)
        estimates = tuple(zip(sides, map(Estimate, values), strict=True))
        return Outcome(
            verdict, reason, estimates, seeds=_seeds(numbers_of_sides[0]), pairs=len(values)
        )

    return measure


def steadier(side: Side, other: Side) -> Callable[[Tables], Outcome]:
    """One side deviates less between seeds than the other at every heading; takes three seeds."""

    def measure(tables: Tables) -> Outcome:
        sides = (side, other)
        numbers_of_sides = [tables.numbers(side) for side in sides]
        if lacking := _lacking(sides, numbers_of_sides):
            return missing(*lacking)
        seeds = min(_seeds(numbers) for numbers in numbers_of_sides)
        values = [numbers["value"].groupby(["sequence", "heading"]) for numbers in numbers_of_sides]
        few = seeds < FEWEST_SEEDS
        spreads = [of_seeds.mean() if few else of_seeds.std() for of_seeds in values]
        verdict, reason = everywhere((spreads[1] - spreads[0]).to_numpy())
        verdict, reason = (UNDECIDED, "few_seeds") if few else (verdict, reason)
        estimates = tuple(zip(sides, map(_from_to, spreads), strict=True))
        return Outcome(verdict, reason, estimates, seeds=seeds, pairs=len(spreads[0]))

    return measure


def untold(side: Side, other: Side, factor: float = 1.0) -> Callable[[Tables], Outcome]:
    """Numbers of a finding whose direction nobody here knows: there is no verdict."""

    def measure(tables: Tables) -> Outcome:
        outcome = ahead(side, other, factor=factor)(tables)
        return (
            outcome
            if outcome.reason == "missing"
            else replace(outcome, verdict=UNDECIDED, reason="untold")
        )

    return measure


def absent(_: Tables) -> Outcome:
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


def _turned(numbers: pd.DataFrame) -> pd.Series:
    """By how many degrees each row's queries are turned, to either side."""
    heading = numbers.index.get_level_values("heading").to_numpy(np.float64)
    return pd.Series(np.minimum(heading, 360 - heading), index=numbers.index)


FULL = Side("nway", "campus", "sci")
ENTROPY = replace(FULL, number="auroc", kind="entropy")
CUT = Side("compare", "campus", "sci")
CAMPUS = tuple(Side("compare", "campus", method) for method in DESCRIPTORS)
TOWN = tuple(Side("compare", "town", method) for method in DESCRIPTORS)
RECORDED = tuple(Side("real", "nclt_keyframes", method) for method in DESCRIPTORS)
SCAN_CONTEXT, M2DP, POINTNETVLAD = CAMPUS
FOUR, FOUR_200 = (replace(FULL, variant=variant) for variant in ("4way", "4way200"))
EIGHT, EIGHT_200 = (replace(FULL, variant=variant) for variant in ("8way", "8way200"))
ONE_WAY, ONE_WAY_200 = (replace(FULL, variant=variant) for variant in ("1way", "1way200"))
PFL, AFL, SAD = (
    Side("street", "suburb", method, "accuracy", "distance", change=VIEWPOINT, level=None)
    for method in ("pfl", "afl", "sad")
)
PFL_ROC, AFL_ROC, SAD_ROC = (replace(side, number="roc_auc") for side in (PFL, AFL, SAD))
PFL_ERROR, AFL_ERROR = (
    replace(side, number="held_out_error", protocol="", change=OF_ALL, level=0.0)
    for side in (PFL, AFL)
)
BLACK_ERROR = replace(PFL_ERROR, number="black_error")
SCI_MS, M2DP_MS, POINTNETVLAD_MS, SCAN_CONTEXT_MS, PFL_MS = (
    Side("compare", "campus", method, "query_ms", "")
    for method in ("sci", "m2dp", "pointnetvlad", "scan_context", "pfl")
)


def _turned_by_chance(side: Side) -> Side:
    return replace(side, change="turned")


def _of(number: str, *sides: Side) -> tuple[Side, ...]:
    return tuple(replace(side, number=number) for side in sides)


def _four(four: Side, eight: Side, single: Side, end: str) -> tuple[Claim, ...]:
    """Four ways against eight where queries are turned, and against one as driven."""
    turned = [_turned_by_chance(side) for side in (four, eight)]
    return (
        Claim(f"four_suffice{end}", 1, ahead(*turned, factor=MOST)),
        Claim(f"four_cost_nothing{end}", 1, ahead(four, single, factor=MOST)),
    )


CLAIMS = (
    Claim("nclt", 1, ahead(FULL, *CAMPUS)),
    Claim("nclt_recorded", 1, ahead(Side("real", "nclt_keyframes", "sci"), *RECORDED)),
    Claim("oxford", 1, ahead(Side("compare", "town", "sci"), *TOWN)),
    Claim(
        "steadier",
        1,
        ahead(*_of("auc_top1_per_100_days", FULL, SCAN_CONTEXT), noise=0.0),
    ),
    Claim("top1_against_25", 1, ahead(FULL, *_of("auc_top25", *CAMPUS))),
    Claim("entropy", 1, ahead(ENTROPY, *_of("auroc", *CAMPUS))),
    Claim("entropy_own", 1, ahead(ENTROPY, replace(ENTROPY, kind="feature_distance"))),
    Claim("half_circle", 1, ahead(SCAN_CONTEXT, TOWN[0])),
    Claim(
        "m2dp_walls", 1, ahead(replace(M2DP, change="construction", level=2.0), M2DP, factor=MOST)
    ),
    Claim(
        "m2dp_wedge", 1, untold(replace(M2DP, change="demolition", level=60.0), M2DP, factor=MOST)
    ),
    Claim(
        "scan_context_turned",
        1,
        keeps_less(_turned_by_chance(SCAN_CONTEXT), SCAN_CONTEXT),
    ),
    Claim("m2dp_turned", 1, keeps_less(_turned_by_chance(M2DP), M2DP)),
    *_four(FOUR, EIGHT, ONE_WAY, ""),
    *_four(FOUR_200, EIGHT_200, ONE_WAY_200, "_200"),
    Claim("jet", 1, ahead(FULL, replace(FULL, variant="grey"))),
    Claim("small_cells", 1, ahead(replace(FULL, grid="5m"), POINTNETVLAD)),
    # Table III, the fastest first
    Claim("times", 1, ordered(SCI_MS, M2DP_MS, POINTNETVLAD_MS, SCAN_CONTEXT_MS), digits=1),
    Claim("trained_in_full", 1, ahead(FULL, CUT)),
    Claim("pfl_accuracy", 2, at_every_heading(PFL, AFL)),
    Claim("pfl_roc", 2, at_every_heading(PFL_ROC, AFL_ROC)),
    Claim(
        "pfl_logistic",
        2,
        at_every_heading(replace(PFL, variant="logistic"), replace(AFL, variant="logistic")),
    ),
    Claim(
        "as_written",
        2,
        at_every_heading(replace(PFL, variant="paper"), replace(AFL, variant="logistic")),
    ),
    Claim("pfl_learns", 2, at_every_heading(PFL, replace(PFL, variant="untrained"))),
    Claim("afl_accuracy", 2, at_every_heading(AFL, SAD)),
    Claim("afl_roc", 2, at_every_heading(AFL_ROC, SAD_ROC)),
    Claim("sad_near", 2, at_every_heading(SAD, None, within_deg=30.0, limit=HALF)),
    Claim("sad_beyond", 2, at_every_heading(SAD, None, sign=-1, beyond_deg=30.0, limit=HALF)),
    Claim("sad_eight", 2, at_every_heading(PFL, replace(SAD, variant="eight_headings"))),
    Claim("nclt_easier", 2, absent),
    Claim("reconstruction", 2, at_every_heading(PFL_ERROR, AFL_ERROR, sign=-1)),
    Claim("black_image", 2, at_every_heading(PFL_ERROR, BLACK_ERROR, sign=-1)),
    Claim("one_heading", 2, at_every_heading(PFL, replace(PFL, variant="one_heading"))),
    Claim("stable", 2, steadier(PFL, AFL)),
    Claim("ten_hertz", 2, below(PFL_MS, SCAN_MS), digits=1),
    Claim(
        "one_kb",
        2,
        below(
            replace(PFL, number="bytes_per_place", change=OF_ALL, level=0.0),
            CODE_B,
            1 / CODES,
        ),
        digits=0,
    ),
)
