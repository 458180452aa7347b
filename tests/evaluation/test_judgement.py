"""The judgement of one test sequence, and its numbers."""

import json
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.evaluation.judgement import Judgement, judge, outcomes, rank_of, summary
from pipeline.schemas import EVALUATIONS

THRESHOLD = 0.5


def poses(xy_m: list[tuple[float, float]]) -> Any:
    world_T_anchor = np.tile(np.eye(4), (len(xy_m), 1, 1))
    world_T_anchor[:, :2, 3] = xy_m
    return world_T_anchor


def drive(**changes: Any) -> Judgement:
    """Five queries: right; right but turned around; true place second; right but rejected; unseen and rejected."""
    arrays: dict[str, Any] = {
        "places": np.array([[7, 1], [8, 1], [1, 9], [3, 1], [2, 1]]),
        "answers_xy_m": np.zeros((5, 2, 2)),
        "novelty": np.array([0.1, 0.2, 0.3, 0.6, 0.9], np.float32),
        "true_places": np.array([7, 8, 9, 3, -1]),
        "world_T_anchor": poses([(3, 4), (0, 1), (6, 8), (0, 2), (0, 50)]),
        "oracle": np.array([7, 8, 8, 3, 2]),
        "turn_deg": np.array([10.0, 180.0, -45.0, 46.0, 0.0]),
        "threshold": THRESHOLD,
    }
    return judge(**(arrays | changes))


def test_a_judgement_is_what_the_schema_of_evaluations_asks_for() -> None:
    judgement = vars(drive())
    assert judgement.keys() == EVALUATIONS.columns.keys()
    lengths: dict[str, int] = {"xy": 2, "top_n": 25, "threshold": 200, "query": 5}
    for name, column in EVALUATIONS.columns.items():
        assert judgement[name].dtype == np.dtype(column.dtype), name
        assert judgement[name].shape == tuple(lengths[dim] for dim in column.dims), name


def test_each_query_has_the_outcome_worked_out_by_hand() -> None:
    # accepted (novelty < .5): right, right, wrong; rejected: seen → miss, unseen → correct rejection
    judgement = drive()
    assert judgement.outcome.tolist() == [0, 0, 2, 1, 3]
    assert judgement.true_rank.tolist() == [0, 0, 1, 0, -1]
    assert judgement.seen.tolist() == [True, True, True, True, False]
    assert judgement.error_m.tolist() == [5.0, 1.0, 10.0, 2.0, 50.0]
    assert judgement.oracle_right.tolist() == [True, True, False, True, False]


def test_the_numbers_of_five_queries_by_hand() -> None:
    numbers = summary(drive(), THRESHOLD, days=20)
    assert numbers["days"] == 20
    assert (numbers["queries"], numbers["seen"], numbers["unseen"]) == (5, 4, 1)
    assert (numbers["top1"], numbers["top5"], numbers["top25"]) == (3 / 4, 1.0, 1.0)
    assert numbers["top1_same_heading"] == 1 / 2  # queries 0 (10°) and 2 (−45°, still the same), of which 0 is right
    assert numbers["top1_turned"] == 1.0  # queries 1 (180°) and 3 (46°)
    assert (numbers["oracle_top1"], numbers["oracle_top1_same_heading"], numbers["oracle_top1_turned"]) == (3 / 4, 1 / 2, 1.0)
    assert numbers["precision_at_threshold"] == 2 / 3  # two hits, one false alarm
    assert numbers["recall_at_threshold"] == 2 / 3  # two hits, one miss
    assert numbers["median_error_m"] == 3.5  # of 1, 2, 5 and 10; the unseen query's 50 does not count
    assert numbers["auc_top1"] == drive().auc[0]


def test_outcomes_at_the_model_s_threshold_agree_with_the_counts_there() -> None:
    judgement = drive(thresholds=np.array([0.0, THRESHOLD]))
    at = [a[0, 1] for a in (judgement.hits, judgement.misses, judgement.false_alarms, judgement.correct_rejections)]
    assert np.bincount(judgement.outcome, minlength=4).tolist() == at


def test_numbers_of_an_all_unseen_sequence_are_valid_json() -> None:
    numbers = summary(drive(true_places=np.full(5, -1)), float("inf"), days=0)
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers
    assert numbers["top1"] is numbers["oracle_top1"] is numbers["median_error_m"] is numbers["threshold"] is None
    assert (numbers["precision_at_threshold"], numbers["recall_at_threshold"]) == (0.0, 0.0)  # all accepted, all false alarms


def test_the_share_of_a_heading_that_no_query_has_is_missing() -> None:
    numbers = summary(drive(turn_deg=np.zeros(5)), THRESHOLD, days=1)
    assert numbers["top1_turned"] is None
    assert numbers["top1_same_heading"] == numbers["top1"]


def test_padding_in_a_ranking_is_not_the_place_of_an_unseen_query() -> None:
    assert rank_of(np.array([-1, 4]), np.array([[-1, -1], [-1, 4]])).tolist() == [-1, 1]


def test_a_query_at_the_threshold_is_rejected() -> None:
    outcome = outcomes(np.array([0, 0]), np.array([True, True]), np.array([0.5, 0.25], np.float32), 0.5)
    assert outcome.tolist() == [1, 0]


def test_labels_of_another_sequence_are_refused() -> None:
    with pytest.raises(InputError, match="one row a query"):
        drive(oracle=np.zeros(4, np.int64))


def test_a_threshold_that_accepts_nothing_has_a_recall_but_no_precision() -> None:
    numbers = summary(drive(threshold=0.0), 0.0, days=1)
    assert (numbers["precision_at_threshold"], numbers["recall_at_threshold"]) == (None, 0.0)
