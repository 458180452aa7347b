"""Tests of the judgement of one test sequence: outcomes and numbers by both protocols, and the
artifact that holds them."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.frames import turns
from pipeline.core.schemas import Labels
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.evaluations import (
    FALSE_NEGATIVE,
    TRUE_POSITIVE,
    Evaluation,
    Evaluations,
    Judgement,
    line,
    metrics,
)
from pipeline.evaluation.judge import PoseEstimates, judge, judge_cases, outcomes
from pipeline.evaluation.numbers import MEASURES, NUMBERS
from pipeline.evaluation.protocols import Distance, GroundTruth
from pipeline.evaluation.rows import evaluation_rows, table
from pipeline.matching.ranking import Ranking, joined
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.perturbations import Case, read_cases
from tests.artifacts import SUITED
from tests.evaluation.made import evaluation as seven_queries
from tests.evaluation.made import of_cases, rows, standing, write

XY_M = np.array([(3, 4), (0, 1), (6, 8), (0, 2), (0, 50)], float)
RANKING = Ranking(
    places=np.array([[7, 1], [8, 1], [1, 9], [3, 1], [2, 1]]),
    costs=np.array([[0.15, 0.9], [0.25, 0.9], [0.35, 0.9], [0.45, 0.9], [0.55, 0.9]], np.float32),
    xy_m=np.zeros((5, 2, 2)),
    novelty=np.array([[0.1, 5], [0.2, 1], [0.3, 3], [0.6, 2], [0.9, 4]], np.float32),
    confidence=np.array([0.95, 0.95, 0.45, 0.95, 0.5], np.float32),
    heading_deg=np.array([[170, 0], [20, 0], [-30, 0], [90, 0], [np.nan, 0]], np.float32),
    kinds=("entropy", "energy"),
)
YAW_DEG = np.array([-170.0, 17.0, 15.0, 90.0, 0.0])
"""The reported headings are 20, 3, 45 and 0 off."""
LABELS = Labels(
    places=np.array([7, 8, 9, 3, -1]),
    cells=np.arange(10),
    oracle=np.array([7, 8, 8, 3, 2]),
    nearest_m=np.array([1.0, 1.0, 4.0, 6.0, 50.0]),
    nearest_turn_deg=np.array([10.0, 180.0, -45.0, 46.0, 0.0]),
    days=20,
    cell_m=10.0,
    x_m=(0.0, 1.0),
    y_m=(0.0, 1.0),
)


LEFT_DEG = np.array([30.0, -90.0, 180.0, 0.0, 10.0], np.float32)
"""The angle by which a case turned each robot."""
TURNED = replace(
    RANKING,
    places=RANKING.places[:, ::-1],
    heading_deg=180 - (180 - RANKING.heading_deg - LEFT_DEG[:, None]) % np.float32(360),
)
"""Reported headings turn with the queries, and answers are swapped: only the third is right."""


def drive(
    ranking: Ranking = RANKING,
    labels: Labels = LABELS,
    xy_m: np.ndarray = XY_M,
    reject_from: tuple[float, ...] = (0.5, 4.5),
    turned_deg: np.ndarray | None = None,
    poses: np.ndarray | None = None,
) -> Evaluation:
    """Five queries, of which the last two are rejected.

    Right; right but turned around; true place second; right; unseen. By distance the third is
    right, 10 m away, and the fourth is not judged, 6 m from training.
    """
    true = standing(xy_m, YAW_DEG if len(xy_m) == 5 else 0.0)
    rules = (Distance(), Bootstrap(block_m=5.0, resamples=40))
    estimates = None if poses is None else PoseEstimates(poses, 0.9)
    return judge(ranking, reject_from, labels, true, *rules, turned_deg, estimates)


def test_an_evaluation_is_what_its_schema_asks_for() -> None:
    turned = Case("turned", repeat=1)
    again = Case("turned", repeat=2)
    cases = {Case(): drive(), turned: drive(TURNED, turned_deg=LEFT_DEG), again: drive()}
    result = of_cases(cases).arrays
    assert result.keys() == Evaluations.columns.keys()
    lengths = {
        "case": 3,
        "protocol": 2,
        "xy": 2,
        "top_n": 25,
        "threshold": 200,
        "query": 5,
        "kind": 2,
        "bound3": 3,
    }
    lengths |= {"number": len(NUMBERS), "measure": len(MEASURES), "confidence2": 2}
    for name, column in Evaluations.columns.items():
        assert result[name].dtype == np.dtype(column.dtype), name
        assert result[name].shape == tuple(lengths[dim] for dim in column.dims), name


def test_each_query_has_the_outcome_worked_out_by_hand() -> None:
    # accepted (novelty < .5): right, right, wrong; rejected: seen → miss, unseen → correct
    # rejection
    evaluation = drive()
    cells = evaluation.cells
    distance = evaluation.distance
    assert (cells.outcome.tolist(), distance.outcome.tolist()) == ([0, 0, 2, 1, 3], [0, 0, 0, 4, 3])
    assert (cells.true_rank.tolist(), distance.true_rank.tolist()) == (
        [0, 0, 1, 0, -1],
        [0, 0, 0, -1, -1],
    )
    assert (cells.seen.tolist(), distance.seen.tolist()) == ([1, 1, 1, 1, 0], [1, 1, 1, 0, 0])
    assert (cells.unseen.tolist(), distance.unseen.tolist()) == ([0, 0, 0, 0, 1], [0, 0, 0, 0, 1])
    assert (cells.oracle_right.tolist(), distance.oracle_right.tolist()) == (
        [1, 1, 0, 1, 0],
        [1, 1, 1, 0, 0],
    )
    assert evaluation.error_m.tolist() == [5.0, 1.0, 10.0, 2.0, 50.0]
    assert evaluation.answer.tolist() == [7, 8, 1, 3, 2]
    assert evaluation.answer_xy_m.tolist() == [[0.0, 0.0]] * 5
    assert evaluation.nearest_m.tolist() == [1.0, 1.0, 4.0, 6.0, 50.0]


def test_headings_and_confidence_are_judged_where_the_answer_is_right() -> None:
    evaluation = drive()
    # Over ±180° too
    assert evaluation.heading_error_deg == pytest.approx(
        [20, 3, 45, 0, np.nan], nan_ok=True, abs=1e-4
    )
    # Right by cells are 0, 1 and 3, by distance 0, 1 and 2.
    name = "median_heading_error_deg"
    assert evaluation.number("cells", name).value == pytest.approx(3.0, abs=1e-4)
    assert evaluation.number("distance", name).value == pytest.approx(20.0, abs=1e-4)
    # Calibration is of the seen, by cells: right are 0, 1, 3, wrong is 2. 1 − cost: .85 .75 .55
    # right and .65 wrong, each in a bin of its own. Confidence: bin .9 … 1 holds 3 of .95, all
    # right; .4 … .5 one of .45, wrong.
    raw = (0.15 + 0.25 + 0.65 + 0.45) / 4
    assert evaluation.calibration == pytest.approx([raw, (3 * 0.05 + 0.45) / 4])
    # The three seen by distance stand within 15 m of one another, in cells of their own.
    assert "degenerate" in line(evaluation, "distance")
    assert "degenerate" not in line(evaluation, "cells")
    assert line(evaluation, "cells").startswith("auc_top1 0.")


def test_the_arrays_and_the_numbers_agree() -> None:
    evaluation = drive()
    for name in ("cells", "distance"):
        judgement = evaluation.protocol(name)
        for n in (1, 5, 25):
            assert judgement.recall_at[n - 1] == evaluation.number(name, f"recall_at_{n}").value
        indices = [NUMBERS.index(measure) for measure in MEASURES]
        assert np.array_equal(judgement.rejection[0], judgement.numbers[indices], equal_nan=True)
        precision, recall = evaluation.curve(name, evaluation.thresholds)
        area = evaluation.number(name, "auc_top1").value
        assert np.trapezoid(precision, recall) == pytest.approx(area)


def test_each_kind_of_novelty_is_measured_at_its_own_threshold() -> None:
    # energy rejects from 4.5 on: only query 0; accepted by cells are right 1, misplaced 2, right 3,
    # unseen 4
    energy = dict(zip(MEASURES, drive().cells.rejection[1, :, 0], strict=True))
    assert energy["precision_at_threshold"] == 2 / 4
    assert energy["recall_at_threshold"] == 2 / 3
    assert energy["auroc"] == 3 / 4  # the unseen 4 is above 1, 2 and 3, and below 5


def test_every_number_lies_in_its_interval() -> None:
    rng = np.random.default_rng(2)
    xy_m = np.stack([np.arange(400.0), np.zeros(400)], axis=1)
    places = rng.integers(0, 4, (400, 3))
    ranking = Ranking(
        *(
            places,
            np.sort(rng.random((400, 3)), axis=1).astype(np.float32),
            xy_m[:, None] + rng.normal(0, 12, (400, 3, 2)),
        ),
        *(
            rng.random((400, 1)).astype(np.float32),
            rng.random(400).astype(np.float32),
            np.zeros((400, 3), np.float32),
            ("entropy",),
        ),
    )
    labels = Labels(
        rng.integers(-1, 4, 400),
        np.arange(4),
        places[:, 1],
        rng.uniform(0, 30, 400),
        rng.uniform(-180, 180, 400),
        20,
        10.0,
        (0.0, 1.0),
        (0.0, 1.0),
    )
    evaluation = drive(
        ranking, labels, xy_m, (0.5,), poses=standing(xy_m + rng.normal(0, 1, xy_m.shape), 0.0)
    )
    for name in ("cells", "distance"):
        result, low, high = evaluation.protocol(name).numbers.T
        inside = (low <= result) & (result <= high)
        # of level sweeps alone
        assert [n for n, ok in zip(NUMBERS, inside, strict=True) if not ok] == ["within_1m_10deg"]
        assert (low < high)[NUMBERS.index("recall_at_1")]


def test_what_is_of_no_query_is_nan() -> None:
    labels = replace(LABELS, places=np.full(5, -1), nearest_m=np.full(5, 99.0))
    evaluation = drive(labels=labels, reject_from=(np.inf, np.inf))
    for name in ("cells", "distance"):
        values = {number: evaluation.number(name, number).value for number in NUMBERS}
        assert values.pop("precision_at_threshold") == 0.0
        assert np.isnan([*values.values()]).all()
    assert np.isnan(evaluation.calibration).all()
    nobody = drive(rows(RANKING, slice(0)), rows(LABELS, slice(0)), XY_M[:0])
    assert line(nobody, "cells").startswith("auc_top1 none recall_at_1 none auroc none")
    rejecting = drive(reject_from=(ACCEPT_NOTHING, 0.0))
    assert np.isnan(rejecting.number("cells", "precision_at_threshold").value)
    assert rejecting.number("cells", "recall_at_threshold").value == 0.0
    silent = np.full(5, np.nan, np.float32)
    evaluation = drive(replace(RANKING, heading_deg=silent[:, None], confidence=silent))
    assert np.isnan(evaluation.number("cells", "heading_within_10deg").value)
    assert np.isnan(evaluation.calibration).all()
    all_seen = drive(rows(RANKING, slice(4)), rows(LABELS, slice(4)), XY_M[:4])
    assert np.isnan(all_seen.number("cells", "auroc")).all()
    assert np.isnan(all_seen.cells.rejection[:, MEASURES.index("auroc")]).all()


def test_each_case_that_is_written_is_read_back(tmp_path: Path) -> None:
    cases = {Case(): drive(), Case("turned", repeat=1): drive(TURNED, turned_deg=LEFT_DEG)}
    artifact = write(tmp_path / "a.zarr", cases)
    assert read_cases(artifact.cases) == [*cases]
    for i, evaluation in enumerate(cases.values()):
        again = artifact.case(i)
        assert (again.kinds, again.reject_from, again.days) == (
            ("entropy", "energy"),
            (0.5, 4.5),
            20,
        )
        assert isinstance(again.distance, Judgement)
        result = of_cases({Case(): again}).arrays
        expected = of_cases({Case(): evaluation}).arrays
        for name in Evaluations.columns:
            np.testing.assert_array_equal(result[name], expected[name], name)


@pytest.mark.parametrize("name", ["numbers", "measures", "protocols"])
def test_an_evaluation_with_other_numbers_is_refused(tmp_path: Path, name: str) -> None:
    artifact = write(tmp_path / "a.zarr", {Case(): drive()}, **{name: ["other"]})
    with pytest.raises(
        ArtifactError, match=rf"a.zarr: its {name} are not this version's; `dvc repro` it"
    ):
        artifact.case()


def test_a_turned_robot_has_a_turned_pose() -> None:
    true = standing(XY_M, YAW_DEG)
    turned = true @ turns(np.deg2rad(LEFT_DEG))
    assert drive(TURNED, turned_deg=LEFT_DEG, poses=turned).pose_error_deg == pytest.approx(
        0, abs=1e-4
    )
    assert drive(TURNED, turned_deg=LEFT_DEG, poses=true).pose_error_deg == pytest.approx(
        np.abs(LEFT_DEG), abs=1e-4
    )


def test_a_turned_robot_is_judged_by_its_own_heading() -> None:
    driven = drive()
    turned = drive(TURNED, turned_deg=LEFT_DEG)
    np.testing.assert_allclose(turned.heading_error_deg, driven.heading_error_deg, atol=1e-4)
    # against the nearest training pose: 10 + 30, 180 − 90, −45 + 180, 46 and 0 + 10; only the first
    # of the seen drives its way
    np.testing.assert_allclose(turned.turn_deg, [40, 90, 135, 46, 10], atol=1e-4)
    assert turned.number("cells", "recall_at_1_turned").value == pytest.approx(1 / 3)
    assert turned.number("cells", "recall_at_1_same_heading").value == 0.0
    nowhere = drive(labels=replace(LABELS, places=np.full(5, -1)))
    shares = [
        table(evaluation_rows(each)).set_index(["number", "protocol"])["value"]
        for each in (turned, driven, nowhere)
    ]
    turned_shares = [share["turned_share", "cells"] for share in shares]
    assert turned_shares == pytest.approx([3 / 4, 2 / 4, np.nan], nan_ok=True)


def test_each_case_is_judged_by_its_own_answers(tmp_path: Path) -> None:
    cases = [Case(), Case("turned", repeat=1)]
    ranking = joined([RANKING, TURNED])
    rankings = schemas.Rankings(
        **vars(ranking),
        turned_deg=np.r_[np.zeros(5), LEFT_DEG].astype(np.float32),
        cases=[asdict(case) for case in cases],
        thresholds=(0.5, 4.5),
        target_precision=0.99,
        validation_precision=(0.812, np.nan),
    )
    store.write(tmp_path / "rankings", rankings)
    store.write(tmp_path / "labels", LABELS)
    with store.draft(
        tmp_path / "submaps", schemas.Submaps, layout="world_T_scan", left_out={}, appearance=SUITED
    ) as draft:
        draft.put("world_T_anchor", standing(XY_M, YAW_DEG))
        draft.put("ground_m", np.zeros(5))
        for name in ("first", "scans", "stamps_ns"):
            draft.put(name, np.arange(5))
        draft.put("used", np.ones(5, bool))
    artifacts = [
        store.read(tmp_path / name, getattr(schemas, name.capitalize()))
        for name in ("rankings", "labels", "submaps")
    ]
    result = judge_cases(*artifacts, Distance(), Bootstrap(block_m=5.0, resamples=40))
    assert list(result) == cases
    assert [(one.target_precision, one.validation_precision[0]) for one in result.values()] == [
        (0.99, 0.812)
    ] * 2
    assert np.isnan(result[Case()].validation_precision[1])
    for one, alone in zip(
        result.values(), (drive(), drive(TURNED, turned_deg=LEFT_DEG)), strict=True
    ):
        arrays = of_cases({Case(): one}).arrays
        for name, column in of_cases({Case(): alone}).arrays.items():
            np.testing.assert_allclose(arrays[name], column, atol=1e-12, err_msg=name)
    # by cells three of the four seen are right unperturbed, the third at second rank; swapped, the
    # third alone
    driven, turned = result.values()
    assert (
        driven.number("cells", "recall_at_1").value,
        turned.number("cells", "recall_at_1").value,
    ) == (
        0.75,
        0.25,
    )
    assert turned.answer.tolist() == [1, 1, 9, 1, 1]
    artifacts[0].cases.pop()
    with pytest.raises(InputError, match="rankings: 10 queries in 1 cases of 5 submaps"):
        judge_cases(*artifacts, Distance(), Bootstrap())


def test_the_curve_passes_every_novelty() -> None:
    # by cells in the order of novelty: right, right, wrong, right, unseen; all four seen count in
    # recall: true positives / (true positives + false negatives)
    precision, recall = drive().curve("cells")
    np.testing.assert_allclose(precision, [1, 1, 1, 2 / 3, 3 / 4, 3 / 5])
    np.testing.assert_allclose(recall, [0, 1 / 4, 2 / 4, 2 / 3, 1, 1])
    # by distance right, right, right, then the one that is not judged, then unseen
    precision, recall = drive().curve("distance")
    np.testing.assert_allclose(precision[-1], 3 / 4)
    assert recall[-1] == 1.0


def test_a_query_at_the_threshold_is_rejected() -> None:
    seen = np.array([True, True])
    outcome = outcomes(
        GroundTruth(seen, ~seen, np.zeros(2, np.int64), seen),
        np.array([0.5, 0.25], np.float32),
        0.5,
    )
    assert outcome.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"labels": replace(LABELS, oracle=np.zeros(4, np.int64))}, "one row a query"),
        ({"ranking": replace(RANKING, places=RANKING.places[:, :0])}, "at least one place"),
        ({"reject_from": (0.5,)}, "2 columns of novelty, 2 kinds and 1 thresholds"),
    ],
)
def test_what_does_not_fit_together_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        drive(**given)


def test_poses_are_judged_and_an_answer_outside_all_places_says_unseen_by_cells_alone() -> None:
    ranking = replace(RANKING, places=np.where(np.arange(5)[:, None] == 0, -1, RANKING.places))
    posed = drive(ranking, poses=standing(XY_M + np.array([0.3, 0.4]), YAW_DEG))
    without = drive(ranking)
    assert posed.pose_error_m == pytest.approx(np.full(5, 0.5))
    assert posed.pose_error_deg == pytest.approx(np.zeros(5), abs=1e-5)
    assert posed.number("distance", "within_2m_5deg").value == 1.0
    assert np.isnan(without.number("distance", "within_2m_5deg").value)
    assert drive().cells.outcome[0] == TRUE_POSITIVE
    assert posed.cells.outcome[0] == FALSE_NEGATIVE
    precision, recall = posed.curve("cells", np.array([np.inf]))
    assert (precision.item(), recall.item()) == (2 / 4, 2 / 3)  # right 1 and 3, wrong 2 and 4
    assert posed.distance.outcome[0] == drive().distance.outcome[0] == TRUE_POSITIVE


def test_a_row_of_metrics_has_few_numbers_and_none_that_are_not_there() -> None:
    # By distance three are seen, all right and accepted; the fourth is not judged, the fifth is
    # rejected: 3 of 4 answered.
    result = metrics(drive())
    assert {name: result[name] for name in ("recall_at_1", "answered", "right_of_answered")} == {
        "recall_at_1": 1.0,
        "answered": 3 / 4,
        "right_of_answered": 1.0,
    }
    assert result["auc_top1"] == drive().number("cells", "auc_top1").value
    assert "within_2m_5deg" not in result  # there are no poses
    assert metrics(drive(poses=standing(XY_M, YAW_DEG)))["within_2m_5deg"] == 1.0


def counts(evaluation: Evaluation) -> dict[str, int]:
    return {name: queries.sum() for name, queries in evaluation.acceptance.items()}


def test_accepted_places_are_counted_at_the_threshold_and_wrong_ones_among_them() -> None:
    """Novelties below .5: the first, third, fourth, fifth and sixth; the third is 200 m off and the
    sixth unseen. Refused: the second, which is right, and the last, unseen."""
    assert counts(seven_queries()) == {
        "accepted": 5,
        "accepted_wrong": 2,
        "refused": 2,
        "refused_wrong": 1,
    }


def test_the_ellipsoids_of_accepted_poses_hold_the_truth() -> None:
    """Novelties below .35: the first, third, fourth and fifth. The ellipsoids of 50, 90 and 95 % in
    six dimensions end at 5.35, 10.64 and 12.59. The fifth pose has no covariance."""
    posed = replace(
        seven_queries(),
        reject_pose_from=0.35,
        pose_square=np.array([1, 99, 10, 12, np.nan, 99, 99]),
    )
    assert posed.in_ellipsoids == pytest.approx(
        {"in_ellipsoid_50": 1 / 3, "in_ellipsoid_90": 2 / 3, "in_ellipsoid_95": 1}
    )


def test_the_square_of_an_error_is_in_units_of_its_deviations() -> None:
    """The second pose is 3 m off with a deviation of 1.5 m: 2² = 4. The last pose is missing."""
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, 0, 3] = 3.0
    poses[2] = np.nan
    covariance = np.tile(np.diag([1, 1, 1, 2.25, 1, 1]), (3, 1, 1))
    estimates = PoseEstimates(poses, 0.5, covariance=covariance)
    truth = np.tile(np.eye(4), (3, 1, 1))
    assert estimates.squares(truth) == pytest.approx([0, 4, np.nan], nan_ok=True)
    assert np.isnan(estimates._replace(covariance=None).squares(truth)).all()
    # of level sweeps the height does not count
    level = estimates._replace(right_within=(1.0, 10.0))
    truth[0, 2, 3] = 5.0
    assert level.squares(truth) == pytest.approx([0, 4, np.nan], nan_ok=True)


def test_accepted_poses_are_counted_by_what_they_target_precision() -> None:
    """Novelties below .35: the first, third (3 m off), fourth and fifth (6° off). Refused: the
    second, the sixth (50 m off), and the last, which has no pose and so no wrong one."""
    posed = replace(
        seven_queries(),
        reject_pose_from=0.35,
        pose_error_m=np.array([0, 0, 3, 0, 0, 50, np.nan]),
        pose_error_deg=np.array([0, 0, 0, 0, 6, 0, np.nan]),
    )
    assert counts(posed) == {
        "accepted": 4,
        "accepted_wrong": 2,
        "refused": 3,
        "refused_wrong": 1,
    }
    # of level sweeps a pose that is 6° off is right
    level = replace(posed, right_within=(1.0, 10.0))
    assert counts(level) == {
        "accepted": 4,
        "accepted_wrong": 1,
        "refused": 3,
        "refused_wrong": 1,
    }
