"""Tests of which queries are seen and which answers are right, by cells and by distance."""

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation.protocols import Distance, by_cells


def test_by_cells_the_query_s_own_cell_is_right_and_padding_is_no_place() -> None:
    places = np.array([[7, 1], [1, 9], [2, 3], [2, 3]])
    true_places = np.array([7, 9, 4, -1])
    ground_truth = by_cells(places, true_places, oracle=np.array([7, 8, 4, 2]))
    assert ground_truth.seen.tolist() == [True, True, True, False]
    assert ground_truth.unseen.tolist() == [False, False, False, True]
    assert ground_truth.true_rank.tolist() == [0, 1, -1, -1]  # first, second, not ranked, unseen
    assert ground_truth.oracle_right.tolist() == [True, False, True, False]
    assert not ground_truth.recall_of_all_seen
    ground_truth = by_cells(np.array([[-1, -1], [-1, 4]]), np.array([-1, 4]), np.array([-1, -1]))
    assert ground_truth.true_rank.tolist() == [-1, 1]
    assert ground_truth.oracle_right.tolist() == [False, False]


def test_by_distance_the_first_answer_near_enough_is_right() -> None:
    # All queries stand at (10, 0). Answers lie at 0, 15, 16 and 40 m from it: right up to 15.
    xy_m = np.tile([10.0, 0.0], (4, 1))
    answers_m = np.array(
        [[[10, 0], [10, 15]], [[10, 16], [10, 15]], [[10, 16], [50, 0]], [[10, 0], [10, 0]]], float
    )
    ground_truth = Distance().ground_truth(
        answers_m, xy_m, nearest_m=np.array([0.0, 4.9, 4.9, 15.1])
    )
    assert ground_truth.true_rank.tolist() == [0, 1, -1, -1]
    assert ground_truth.oracle_right.tolist() == [True, True, True, False]
    assert ground_truth.recall_of_all_seen
    # An answer without a position is wrong, and so is the nearest anchor where it is farther than
    # right reaches.
    ground_truth = Distance().ground_truth(
        np.array([[[np.nan, 0.0], [0.0, 0.0]]]), np.zeros((1, 2)), np.zeros(1)
    )
    assert ground_truth.true_rank.tolist() == [1]
    ground_truth = Distance(seen_m=5.0, correct_m=3.0).ground_truth(
        np.zeros((2, 1, 2)), np.zeros((2, 2)), np.array([2.0, 4.0])
    )
    assert ground_truth.oracle_right.tolist() == [True, False]


def test_between_seen_and_unseen_a_query_is_not_judged() -> None:
    nearest_m = np.array([4.9, 5.0, 15.0, 15.1])  # seen below 5, unseen above 15
    ground_truth = Distance().ground_truth(np.zeros((4, 1, 2)), np.zeros((4, 2)), nearest_m)
    assert ground_truth.seen.tolist() == [True, False, False, False]
    assert ground_truth.unseen.tolist() == [False, False, False, True]
    assert ground_truth.true_rank.tolist() == [0, -1, -1, -1]


def test_distances_that_make_no_sense_are_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"distance.seen_m=20.0: expected at most distance.unseen_m=15.0"
    ):
        Distance(seen_m=20.0)
    with pytest.raises(ConfigError, match=r"distance.correct_m=0: expected a number above 0"):
        Distance(correct_m=0)
    with pytest.raises(ConfigError, match=r"distance.seen_m=near: expected a number"):
        Distance(seen_m="near")  # type: ignore[arg-type]
