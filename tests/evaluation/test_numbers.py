"""Tests of the numbers by which methods are compared, for six queries worked out by hand and for
weighted ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.evaluation.curves import auc, precision_recall
from pipeline.evaluation.numbers import MEASURES, NUMBERS, POSES, Queries, measures, median, numbers
from pipeline.evaluation.protocols import GroundTruth
from tests.evaluation.made import NOVELTY, SEEN, THRESHOLDS, TOY, count

QUERIES = Queries(
    novelty=np.stack([NOVELTY, np.array([7, 7, 7, 9, 8, 8], np.float32)], axis=1),
    reject_from=(0.5, 7.5),
    thresholds=np.r_[0.0, THRESHOLDS],
    error_m=np.array([1.0, 40.0, 2.0, 90.0, 4.0, 80.0]),
    turn_deg=np.array([10.0, -45.0, 46.0, 0.0, 180.0, 0.0]),
    nearest_m=np.array([1.0, 2.0, 3.0, 6.0, 4.0, 2.5]),
    heading_error_deg=np.array([2.0, 1.0, 10.0, 3.0, 170.0, np.nan]),
    pose_error_m=np.array([0.1, 3.0, 1.9, np.nan, 0.4, 0.3]),
    pose_error_deg=np.array([1.0, 1.0, 4.0, np.nan, 1.5, 1.0]),
    pose_square=np.full(6, np.nan),
    reject_pose_from=0.5,
)
EVERYONE = np.ones((1, 6))


def values_by_name(
    ground_truth: GroundTruth = TOY, queries: Queries = QUERIES, weight: np.ndarray = EVERYONE
) -> dict[str, float]:
    return {name: value.item() for name, value in numbers(ground_truth, queries, weight).items()}


def test_the_numbers_of_six_queries_by_hand() -> None:
    result = values_by_name()
    assert tuple(result) == NUMBERS
    assert (result["recall_at_1"], result["recall_at_5"], result["recall_at_25"]) == (
        3 / 4,
        1.0,
        1.0,
    )
    # Queries 0 (10°) and 1 (−45°, still the same), of which 0 is right
    assert result["recall_at_1_same_heading"] == 1 / 2
    assert result["recall_at_1_turned"] == 1.0  # queries 2 (46°) and 4 (180°)
    assert (result["oracle"], result["oracle_same_heading"], result["oracle_turned"]) == (
        3 / 4,
        1.0,
        1 / 2,
    )
    # As in test_curves.py
    assert (
        result["auc_top1"]
        == result["auc_exact_top1"]
        == pytest.approx(0.25 + 0.0625 + 7 / 36 + 11 / 60)
    )
    assert result["f1_max"] == pytest.approx(0.75)
    assert result["recall_at_99_precision"] == 1 / 4
    assert result["auroc"] == 7 / 8
    assert result["precision_at_threshold"] == 1 / 2  # below .5: right, misplaced, right, unseen
    assert result["recall_at_threshold"] == 2 / 3  # two true positives, one false negative
    assert result["median_error_m"] == 3.0  # of 1, 2, 4 and 40
    # Of 2, 10 and 170: query 1 is misplaced, 3 and 5 are unseen
    assert result["median_heading_error_deg"] == 10.0
    assert result["heading_within_10deg"] == 2 / 3
    # The oracle, nearest first: queries 0 and 1 right, 5 unseen, 2 right, 4 misplaced, 3 unseen.
    # Precision falls from 1 after the second to 2/3, 3/4, 3/5, 3/6, recall rises 1/4, 2/4, 2/4,
    # 3/4, 1, 1.
    assert result["oracle_auc_exact_top1"] == pytest.approx(
        1 / 2 + (2 / 3 + 3 / 4) / 8 + (3 / 4 + 3 / 5) / 8
    )
    # By the usual recall a misplaced query is not recalled.
    result = values_by_name(replace(TOY, recall_of_all_seen=True))
    assert result["recall_at_threshold"] == 2 / 4  # two true positives of four seen
    assert result["auc_exact_top1"] == pytest.approx((1 + 7 / 12 + 11 / 20) / 4)  # test_curves.py
    assert result["f1_max"] == pytest.approx(2 / 3)
    assert result["precision_at_threshold"] == 1 / 2


def test_poses_are_judged_by_both_measures_and_the_target_precision() -> None:
    result = values_by_name()
    assert result["within_2m_5deg"] == 3 / 4  # seen are 0, 1, 2, 4; 1 is 3 m off
    assert result["within_05m_2deg"] == 2 / 4
    assert result["within_2m_5deg_same_heading"] == 1 / 2  # queries 0 and 1
    assert result["within_2m_5deg_turned"] == 1.0  # queries 2 and 4
    assert result["within_2m_5deg_beside"] == 2 / 3  # queries 1, 2 and 4
    assert (result["error_m"], result["error_deg"]) == (1.15, 1.25)
    assert result["wrong_of_accepted_99"] == 2 / 4  # accepted are 0, 1, 2 and, without a pose, 3
    assert result["recall_99"] == 2 / 4
    # √((.01 + 9 + 3.61 + .16 + .09) / 5) over the five that have a pose
    assert result["trajectory_m"] == pytest.approx(np.sqrt(12.87 / 5))
    assert np.isnan(result["within_1m_10deg"])  # of level sweeps alone
    level = values_by_name(queries=replace(QUERIES, right_within=(1.0, 10.0)))
    assert level["within_1m_10deg"] == 2 / 4  # 1 and 2 are 3 and 1.9 m off
    assert level["wrong_of_accepted_99"] == 3 / 4
    right_though_unseen = values_by_name(
        queries=replace(QUERIES, novelty=QUERIES.novelty[[0, 1, 2, 5, 4, 3]])
    )
    assert right_though_unseen["wrong_of_accepted_99"] == 1 / 4  # 5 in place of 3
    without = values_by_name(queries=replace(QUERIES, reject_pose_from=np.nan))
    assert all(np.isnan(without[name]) for name in POSES)
    assert without == pytest.approx(result | dict.fromkeys(POSES, np.nan), nan_ok=True)
    none_accepted = values_by_name(queries=replace(QUERIES, reject_pose_from=-1.0))
    assert np.isnan(none_accepted["wrong_of_accepted_99"])
    assert none_accepted["recall_99"] == 0


def test_each_kind_of_novelty_rejects_at_its_own_threshold() -> None:
    first, second = (
        {name: value.item() for name, value in measures(TOY, QUERIES, kind, EVERYONE).items()}
        for kind in (0, 1)
    )
    assert tuple(first) == MEASURES
    assert first == {name: values_by_name()[name] for name in MEASURES}
    # The second kind accepts queries 0, 1, 2 below 7.5: two true positives, a false positive, and
    # the seen query 4 missed.
    assert (second["precision_at_threshold"], second["recall_at_threshold"]) == (2 / 3, 2 / 3)
    # 9 is above all four seen; 8 above three and level with one
    assert second["auroc"] == (4 + 3.5) / 8


def test_the_area_is_that_of_the_authors_counts() -> None:
    rng = np.random.default_rng(1)
    seen = rng.random(400) < 0.8
    ground_truth = GroundTruth(
        seen, ~seen, np.where(seen, rng.integers(-1, 30, 400) // 3, -1), seen
    )
    novelty = rng.random((400, 1)).astype(np.float32)
    thresholds = np.linspace(0, 1, 200)
    result = values_by_name(
        ground_truth,
        Queries(novelty, (0.5,), thresholds, *rng.random((7, 400)), 0.5),
        np.ones((1, 400)),
    )
    areas = auc(*precision_recall(count(ground_truth, novelty[:, 0], thresholds)))
    assert [result[f"auc_top{n}"] for n in (1, 5, 25)] == areas[[0, 4, 24]].tolist()


def test_a_heading_that_is_not_reported_counts_neither_way() -> None:
    result = values_by_name(
        queries=replace(QUERIES, heading_error_deg=np.array([np.nan, 1.0, 10.0, 3.0, 170.0, 0.0]))
    )
    assert (result["median_heading_error_deg"], result["heading_within_10deg"]) == (90.0, 1 / 2)
    result = values_by_name(queries=replace(QUERIES, heading_error_deg=np.full(6, np.nan)))
    assert np.isnan([result["median_heading_error_deg"], result["heading_within_10deg"]]).all()


@pytest.mark.parametrize(
    ("threshold", "precision_and_recall"), [(0.0, (np.nan, 0.0)), (np.inf, (3 / 6, 1.0))]
)
def test_a_threshold_that_accepts_nothing_has_no_precision_and_one_without_end_accepts_all(
    threshold: float, precision_and_recall: tuple[float, float]
) -> None:
    result = values_by_name(queries=replace(QUERIES, reject_from=(threshold, threshold)))
    assert (result["precision_at_threshold"], result["recall_at_threshold"]) == pytest.approx(
        precision_and_recall, nan_ok=True
    )


def test_a_number_of_nothing_is_missing() -> None:
    # Without a seen query only precision is defined, without an unseen one only auroc is missing.
    nobody = np.zeros(6, bool)
    result = values_by_name(GroundTruth(nobody, ~nobody, np.full(6, -1), nobody))
    assert result.pop("precision_at_threshold") == 0.0  # whatever is accepted is a false positive
    # A pose may be right where training never went
    assert result.pop("wrong_of_accepted_99") == 2 / 4
    assert result.pop("trajectory_m") > 0  # of all queries
    assert all(np.isnan(value) for value in result.values())
    result = values_by_name(GroundTruth(SEEN, np.zeros(6, bool), TOY.true_rank, TOY.oracle_right))
    assert [name for name, value in result.items() if np.isnan(value)] == [
        "auroc",
        "within_1m_10deg",  # of level sweeps alone
    ]
    result = values_by_name(queries=replace(QUERIES, turn_deg=np.zeros(6)))
    assert np.isnan(result["recall_at_1_turned"])
    assert np.isnan(result["oracle_turned"])
    assert result["recall_at_1_same_heading"] == result["recall_at_1"]


@given(
    st.lists(
        st.tuples(  # weight, whether seen, rank, level of novelty, error, turn, heading's error
            *(
                st.integers(0, 3),
                st.sampled_from(["seen", "unseen", "between"]),
                st.integers(-1, 8),
                st.integers(0, 6),
            ),
            *(
                st.integers(0, 50),
                st.sampled_from([0.0, 180.0]),
                st.sampled_from([0.0, 20.0, np.nan]),
            ),
        ),
        min_size=1,
        max_size=25,
    ),
    st.booleans(),
)
def test_a_weight_is_a_number_of_equal_queries(
    rows: list[tuple[int, str, int, int, int, float, float]], usual: bool
) -> None:
    weight, where, rank, level, error_m, turn_deg, off_deg = (
        np.array(column) for column in zip(*rows, strict=True)
    )

    def of(index: np.ndarray, weight: np.ndarray) -> dict[str, float]:
        seen = where[index] == "seen"
        unseen = where[index] == "unseen"
        ground_truth = GroundTruth(
            seen, unseen, np.where(seen, rank[index], -1), seen & (rank[index] % 2 == 0), usual
        )
        novelty = (level[index, None] / 6).astype(np.float32)
        errors = (
            error_m[index] / 2,
            turn_deg[index],
            6.0 - level[index],
            off_deg[index],
            error_m[index] / 9,
            off_deg[index] / 3,
            np.full(len(index), np.nan),
            0.7,
        )
        return values_by_name(
            ground_truth, Queries(novelty, (0.6,), np.linspace(0, 1, 20), *errors), weight
        )

    weighted = of(np.arange(len(rows)), weight[None].astype(float))
    repeated = of(np.repeat(np.arange(len(rows)), weight), np.ones((1, weight.sum())))
    assert weighted == pytest.approx(repeated, nan_ok=True)


def test_each_resample_has_its_own_numbers() -> None:
    weight = np.array([[1, 1, 1, 1, 1, 1], [2, 0, 1, 0, 1, 3], [0, 0, 0, 1, 0, 1]], float)
    together = numbers(TOY, QUERIES, weight)
    for i, row in enumerate(weight):
        assert values_by_name(weight=row[None]) == pytest.approx(
            {name: value[i] for name, value in together.items()}, nan_ok=True
        )


@given(st.lists(st.tuples(st.floats(-100, 100), st.integers(0, 4)), min_size=1, max_size=20))
def test_a_weighted_median_is_that_of_the_repeated_values(pairs: list[tuple[float, int]]) -> None:
    values, weight = (np.array(column) for column in zip(*pairs, strict=True))
    expected = np.median(np.repeat(values, weight)) if weight.any() else np.nan
    np.testing.assert_allclose(median(values, weight[None].astype(float)), [expected])


def test_an_answer_without_a_position_errs_the_most() -> None:
    values = np.array([np.nan, 1.0, 2.0, np.nan])
    assert median(values, np.array([[1, 1, 1, 0]], float)).tolist() == [2.0]  # of 1, 2 and no end
    assert np.isnan(median(values, np.array([[1, 0, 1, 1]], float))).all()
