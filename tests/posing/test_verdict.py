"""Tests of verdicts on small evidence, worked out by hand: the error probabilities of claims, and
the thresholds that reach a target precision."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.fix import ScanFix
from pipeline.posing.verdict import (
    CLAIMS,
    OF_SCANS,
    TARGET_PRECISIONS,
    FixEvidence,
    Judge,
    middle,
    usual_thresholds,
)
from tests.posing.scene import OVERLAPS, hypothesis, planar
from tests.readers.damage import one_line


def test_the_error_probabilities_of_the_three_claims() -> None:
    """Odds of e², 1, e⁻¹ and e⁻² against 1, at 0, 3, 40 and 80 m: the first two are near, the
    second is no runner-up."""
    fix = ScanFix.of(
        [hypothesis(x_m, overlap) for x_m, overlap in ((0, 0.7), (3, 0.5), (40, 0.4), (80, 0.3))],
        OVERLAPS,
    )
    odds = np.exp([2.0, 0.0, -1.0, -2.0])
    shares = odds / (1 + odds.sum())
    error_probabilities = Judge(OVERLAPS, OVERLAPS).error_probabilities(fix)
    assert error_probabilities == pytest.approx(
        1 - np.array([shares[0], shares[:2].sum(), shares[[0, 2, 3]].sum()])
    )
    assert Judge(OVERLAPS, OVERLAPS).error_probabilities(ScanFix()).tolist() == [1, 1, 1]


def evidence(blocks: int, wrong: int = 0, seed: int = 0) -> FixEvidence[ScanFix]:
    """A right fix of much overlap in each block, and one of little without its surroundings; the
    first few of these overlap."""
    rng = np.random.default_rng(seed)
    fixes = []
    true = []
    for block in range(blocks):
        fixes.append(ScanFix.of([hypothesis(0, rng.uniform(0.6, 0.8))]))
        fixes.append(
            ScanFix.of(
                [hypothesis(0, rng.uniform(0.6, 0.8) if block < wrong else rng.uniform(0.2, 0.3))]
            )
        )
        true += [planar(0, 0, 0), planar(300, 0, 0)]
    return FixEvidence(
        fixes, np.array(true), np.tile([False, True], blocks), np.arange(blocks).repeat(2)
    )


def test_right_and_near_are_judged_separately() -> None:
    fixes = [ScanFix.of([hypothesis(x_m, 0.7)]) for x_m in (1.9, 2.1, 14.0, 16.0)]
    fixes.append(ScanFix.of([hypothesis(50, 0.7), hypothesis(0, 0.6)]))
    known_evidence = FixEvidence(
        [*fixes, ScanFix()], np.tile(np.eye(4), (6, 1, 1)), np.zeros(6, bool), np.arange(6)
    )
    _, ground_truths = known_evidence.judged(Judge(OVERLAPS, OVERLAPS))
    assert ground_truths.tolist() == [
        [True, True, True],
        [False, True, False],
        [False, True, False],
        [False, False, False],
        [False, False, True],
        [False] * 3,
    ]
    assert OF_SCANS.right(np.full((1, 4, 4), np.nan), np.eye(4)[None]).tolist() == [False]


def test_a_target_precision_is_reached_only_if_one_more_wrong_block_would_not_break_it() -> None:
    """The share .8 of the blocks is seen. With 200 blocks, 160 accepted queries reach .99 (160 of
    161 would be .9938), but not .995. With 100 blocks, 80 reach .985 (80 of 81 would be .9877), not
    .99; with 15, 12 reach .9 (12 of 13 would be .923)."""
    many, some, few = (evidence(blocks).verdict(0.2) for blocks in (200, 100, 15))
    assert many.reachable == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)
    assert some.reachable == (0.9, 0.95, 0.97, 0.98, 0.985)
    assert few.reachable == (0.9,)
    assert few.claim_thresholds["fix"][1] == ACCEPT_NOTHING
    assert few.thresholds == {0.9: tuple(few.claim_thresholds[claim][0] for claim in CLAIMS)}


def test_more_precision_never_accepts_more() -> None:
    for wrong in (0, 5, 20, 60):
        for thresholds in evidence(200, wrong).verdict(0.2).claim_thresholds.values():
            assert (np.diff(thresholds) <= 0).all()


def test_wrong_fixes_among_the_accepted_break_a_target_precision() -> None:
    """20 of 200 unseen queries look right and count .2 each: with 4 wrong of 164 and one more, .9697
    are right. A threshold that leaves some of the 164 out reaches .97, none reaches .98."""
    assert evidence(200, wrong=20).verdict(0.2).reachable == (0.9, 0.95, 0.97)


def test_no_fix_is_accepted_at_many_times_the_error_of_the_target_precision() -> None:
    """All are right, even those of little overlap, so no threshold misses a target precision: .99
    allows an error probability of .15; .9 and .95 would allow more, but half is the most.
    """
    fixes = [
        ScanFix.of([hypothesis(0, overlap)], OVERLAPS) for overlap in np.linspace(0.3, 0.9, 2000)
    ]
    sure = FixEvidence(
        fixes, np.tile(np.eye(4), (2000, 1, 1)), np.zeros(2000, bool), np.arange(2000)
    )
    thresholds = sure.thresholds(Judge(OVERLAPS, OVERLAPS), 0.2)
    assert thresholds["fix"] == pytest.approx([0.5, 0.5, 0.45, 0.3, 0.225, 0.15, 0.075, 0.015])


def test_a_threshold_lies_in_the_middle_of_a_gap() -> None:
    """The middle of the odds 1/9 and 9 is 1."""
    assert middle(np.array([0.05, 0.1, 0.9]), 0.11) == pytest.approx(0.5)
    assert middle(np.array([0.05, 0.1]), 0.11) == 0.11  # beyond all there is no gap
    assert middle(np.array([0.5]), ACCEPT_NOTHING) == ACCEPT_NOTHING


def test_the_usual_threshold_is_that_of_the_least_measured_precision_above() -> None:
    assert usual_thresholds({0.95: 0.25, 0.99: 0.05}) == (
        *(0.25, 0.25),  # .9 and .95
        *(0.05, 0.05, 0.05, 0.05),  # .97, .98, .985 and .99
        *(ACCEPT_NOTHING, ACCEPT_NOTHING),
    )


def test_asked_for_more_than_it_keeps_a_verdict_keeps_the_largest_below() -> None:
    """80 accepted queries reach .985, not .99."""
    verdict = evidence(100).verdict(0.2)
    assert [verdict.kept_precision(wanted) for wanted in (0.999, 0.99, 0.985, 0.975, 0.9)] == [
        *(0.985, 0.985, 0.985),
        *(0.98, 0.9),  # .98 promises more than .975
    ]
    assert verdict.kept_precision(0.5) == 0.9  # which promises more
    assert verdict.kept_precision(None) is None
    assert verdict.kept_words(0.99) == "this site can keep .985, not .99: accepted means .985"
    assert verdict.kept_words(0.985) is None
    with one_line(InputError, "target_precision=0.99: this site has no threshold for it"):
        verdict.kept_precision(0.99, strict=True)
    for no_share in (0.0, 1.5, np.nan):
        with one_line(InputError, "expected a share above 0 and at most 1"):
            verdict.kept_precision(no_share)


def test_a_verdict_that_keeps_nothing_says_why() -> None:
    """5 blocks, 4 of them seen, do not even reach .9, which takes 9."""
    verdict = evidence(5).verdict(0.2)
    assert verdict.kept_precision(0.99) is None
    assert verdict.kept_words(0.99) == (
        "this site can keep no target precision: nothing is accepted (its 5 validation blocks are "
        "too few, or too often wrong)"
    )
    with one_line(InputError, "no threshold for it; nor for any other; choose none"):
        verdict.kept_precision(0.99, strict=True)


def test_without_evidence_nothing_is_accepted() -> None:
    none: FixEvidence[ScanFix] = FixEvidence.joined([])
    assert none.verdict(0.2).claim_thresholds["fix"] == (ACCEPT_NOTHING,) * len(TARGET_PRECISIONS)


def test_joined_evidence_has_consecutive_numbers_of_blocks() -> None:
    assert FixEvidence.joined([evidence(2), evidence(1)]).block.tolist() == [0, 0, 1, 1, 2, 2]
