"""Verdicts on level fixes: the error probabilities of claims, and thresholds by validation
stretches."""

import numpy as np
import pytest

from pipeline.level.beams import Support
from pipeline.level.fix import Hypothesis, LevelFix, LevelFixer
from pipeline.level.validation import LevelValidation
from pipeline.level.verdict import NO_EVIDENCE, OF_SWEEPS, USUAL, USUAL_THRESHOLDS, verdict_of
from pipeline.posing.verdict import FixEvidence
from tests.level.hall import drawing, drive, pose


def hypothesis(
    x_m: float, score: float = 0.95, through: float = 0.0, sd_m: float = 0.03
) -> Hypothesis:
    """A hypothesis at (x, 0), heading along x."""
    covariance = np.diag([sd_m**2, sd_m**2, 0.01**2])
    return Hypothesis(pose(x_m, 0, 0), covariance, score, Support(0.9, 0.0, through))


def fixes_of(*scores: float) -> LevelFix:
    """Hypotheses of these scores, 10 m apart from (0, 0) on."""
    return LevelFix(tuple(hypothesis(10.0 * n, score) for n, score in enumerate(scores)))


def test_each_feature_of_a_hypothesis_raises_its_probability() -> None:
    usual = USUAL.error_probabilities(fixes_of(0.9, 0.75))[0]
    assert USUAL.error_probabilities(fixes_of(0.95, 0.75))[0] < usual
    assert USUAL.error_probabilities(fixes_of(0.9, 0.85))[0] > usual
    loose = LevelFix((hypothesis(0, 0.9, sd_m=0.5), hypothesis(10, 0.75)))
    assert USUAL.error_probabilities(loose)[0] > usual
    contradicted = LevelFix((hypothesis(0, 0.9, through=0.3), hypothesis(10, 0.75)))
    assert USUAL.error_probabilities(contradicted)[0] > usual
    assert USUAL.error_probabilities(LevelFix()).tolist() == [1, 1, 1]


def test_being_ahead_of_a_bad_hypothesis_counts_no_more_than_being_alone() -> None:
    # a hypothesis alone counts as if another had .75 of its quality; here the other has less
    alone = fixes_of(0.8).features
    ahead = fixes_of(0.8, 0.3).features
    assert alone[0, -1] == pytest.approx(0.25 * 0.8)
    assert ahead[0, -1] == alone[0, -1]


def test_of_two_equal_poses_neither_is_accepted_but_the_claim_several_is() -> None:
    error_probabilities = USUAL.error_probabilities(fixes_of(0.95, 0.95))
    assert error_probabilities[0] > USUAL_THRESHOLDS["fix"][0]
    assert error_probabilities[2] < error_probabilities[0] / 2
    # a single pose of a high error probability does not become one of several accepted poses
    assert (
        USUAL.error_probabilities(fixes_of(0.5))[2]
        == USUAL.error_probabilities(fixes_of(0.5))[0]
        > 0.3
    )


def test_right_is_within_a_metre_and_ten_degrees() -> None:
    true = np.stack([pose(0, 0, 0)] * 3)
    poses = np.stack([pose(0.9, 0, 0.15), pose(1.1, 0, 0), pose(0, 0, 0.2)])  # .15 rad is 8.6°
    assert OF_SWEEPS.right(poses, true).tolist() == [True, False, False]
    is_right, is_near = OF_SWEEPS.right_and_near(fixes_of(0.9, 0.8), pose(0.2, 0, 0))
    assert is_right.tolist() == [True, False]
    assert is_near.tolist() == [True, False]


def evidence(right_count: int, wrong_count: int) -> FixEvidence[LevelFix]:
    """Fixes of nearly no error probability, each in its own block: first right, then wrong ones."""
    count = right_count + wrong_count
    true = np.stack([pose(0 if n < right_count else 30, 0, 0) for n in range(count)])
    return FixEvidence([fixes_of(0.99, 0.5)] * count, true, np.zeros(count, bool), np.arange(count))


def test_a_map_lowers_the_usual_thresholds_only_if_its_own_fixes_miss_a_precision() -> None:
    for unbroken in (NO_EVIDENCE, evidence(20, 0)):
        assert verdict_of(unbroken, 0.2).claim_thresholds == USUAL_THRESHOLDS
    # 2 of 22 wrong, all of one error probability: .9, and no threshold reaches .95 or more
    assert verdict_of(evidence(20, 2), 0.2).reachable == (0.9,)


def test_evidence_reaches_only_precisions_that_one_more_wrong_fix_would_not_break() -> None:
    # 30 right: 30 / 31 is .968, so .95 is reached and .97 is not
    thresholds = evidence(30, 0).thresholds(USUAL, 0.0)["fix"]
    assert [threshold > 0 for threshold in thresholds] == [*2 * [True], *6 * [False]]


def test_validation_stretches_are_found_on_a_map_with_their_surroundings_only() -> None:
    sweeps = drive()
    validation = LevelValidation(every_m=6.0, around_m=(30.0,))
    own = validation.evidence(LevelFixer(), sweeps, drawing(sweeps, cell_m=0.1), 3.0)
    assert own.blocks == len(own.fixes) // 2 >= 3
    # the whole hall lies within 30 m: the remaining map is empty
    for fix, true, unseen in zip(own.fixes, own.world_T_true, own.unseen, strict=True):
        assert bool(fix.hypotheses) != bool(unseen)
        if not unseen:
            assert OF_SWEEPS.right_and_near(fix, true)[0][0]
