"""Tests of the expectations: features are compared with those of right fixes nearby."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.frames import pose
from pipeline.posing.expectations import FEATURE_ROWS, POSITIONS, Expectations
from pipeline.posing.fix import Hypothesis, ScanFix
from pipeline.posing.probabilities import FEATURES
from pipeline.posing.validation import with_expectations
from pipeline.posing.verdict import FixEvidence
from tests.posing.scene import hypothesis

STREET = [hypothesis(x_m, 0.6) for x_m in (0.0, 5.0, 10.0)]
FIELD = [hypothesis(x_m, 0.2) for x_m in (200.0, 205.0, 210.0, 215.0, 220.0)]


def overlap(candidate: Hypothesis) -> float:
    return float(candidate.features[FEATURES.index("overlap")])


def evidence(hypotheses: list[Hypothesis], unseen: list[bool]) -> FixEvidence:
    """One fix of one hypothesis in each block, each at its true pose."""
    count = len(hypotheses)
    return FixEvidence(
        [ScanFix.of([candidate]) for candidate in hypotheses],
        np.array([candidate.world_T_query for candidate in hypotheses]),
        np.array(unseen),
        np.arange(count),
    )


def test_right_fixes_of_a_field_exceed_the_day_by_their_median() -> None:
    # overlaps .6 three times and .2 five times: the day's median is .2, that of the street .6
    every = STREET + FIELD
    day = Expectations(
        np.array([candidate.world_T_query[:2, 3] for candidate in every]),
        np.array([candidate.features for candidate in every]),
    )
    assert day.excess(np.array([4.0, 3.0]))[0] == pytest.approx(0.4)
    assert day.excess(np.array([210.0, 0.0]))[0] == pytest.approx(0.0)


def test_nothing_is_expected_where_fewer_than_three_right_fixes_lie() -> None:
    day = Expectations(np.array([[0.0, 0.0], [1.0, 0.0]]), np.ones((2, len(FEATURES))))
    assert not day.excess(np.zeros(2)).any()
    assert not Expectations().excess(np.zeros(2)).any()


def test_validation_fixes_are_judged_by_the_right_fixes_of_other_blocks() -> None:
    # On the field a right fix of another block had .2. The day without the fix itself: .6 thrice,
    # .2 four times, so .2 is usual, and .2 counts as it is.
    judged = with_expectations(evidence(STREET + FIELD, 8 * [False]))
    assert overlap(judged.fixes[5].hypotheses[0]) == pytest.approx(0.2)
    # Only two others lie around the end of the street: too few.
    assert overlap(judged.fixes[0].hypotheses[0]) == pytest.approx(0.6)
    assert len(judged.expectations.xy_m) == 8


def test_a_fix_in_a_place_of_more_overlap_counts_for_less() -> None:
    busy = [*STREET, hypothesis(14.0, 0.6)]
    judged = with_expectations(evidence(busy + FIELD, 9 * [False]))
    # .6 is expected among the other three of the street, .2 on the day: .4 more
    assert overlap(judged.fixes[0].hypotheses[0]) == pytest.approx(0.2)


def test_wrong_fixes_and_novel_places_add_no_expectations() -> None:
    before = evidence(STREET, [False, True, False])
    moved = pose(np.array([[50.0, 0.0, 0.0]]), np.zeros((1, 3)))[0] @ before.world_T_true[2]
    ground_truth = np.array([*before.world_T_true[:2], moved])
    judged = with_expectations(replace(before, world_T_true=ground_truth))
    assert judged.expectations.xy_m.tolist() == [[0.0, 0.0]]


def test_a_day_without_a_right_fix_stays_as_it_is() -> None:
    unseen = evidence(STREET, 3 * [True])
    assert with_expectations(unseen) is unseen


def test_a_site_file_keeps_expectations() -> None:
    day = Expectations(np.ones((4, 2)), np.ones((4, len(FEATURES))))
    kept = Expectations.of_arrays(day.arrays)
    assert (kept.xy_m == day.xy_m).all()
    assert (kept.features == day.features).all()


@pytest.mark.parametrize(
    "changed",
    [
        {FEATURE_ROWS: np.ones((4, len(FEATURES) - 1))},
        {FEATURE_ROWS: np.ones((3, len(FEATURES)))},
        {POSITIONS: np.full((4, 2), np.nan)},
    ],
    ids=["a feature too few", "a fix too few", "no number"],
)
def test_a_site_whose_expectations_do_not_fit_is_refused(changed: dict[str, np.ndarray]) -> None:
    day = Expectations(np.ones((4, 2)), np.ones((4, len(FEATURES))))
    with pytest.raises(ValueError, match="expected_"):
        Expectations.of_arrays(day.arrays | changed)
