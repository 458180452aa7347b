"""Tests of precision, recall and the areas under curves: by hand, against scikit-learn, and against
the SCI authors' published counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat
from sklearn import metrics

from pipeline.evaluation.counts import Counts, ExactCounts
from pipeline.evaluation.curves import auc, auroc, f1_max, precision_recall, recall_at_precision
from pipeline.evaluation.protocols import GroundTruth
from tests.evaluation.made import NOVELTY, THRESHOLDS, TOY, count

OFFICIAL = Path(__file__).parents[2].parent / "shared" / "real" / "nclt" / "official_sci_counts"
recorded = pytest.mark.skipif(
    not OFFICIAL.is_dir(), reason=f"the SCI authors' published counts are not at {OFFICIAL}"
)

PUBLISHED = {  # METHODS.md 2.7: AUC top-1, top-5, top-25; Table II: seen, unseen
    "2012-02-04": ((0.9369, 0.9743, 0.9795), (5170, 441)),
    "2012-03-17": ((0.9258, 0.9742, 0.9813), (5449, 428)),
    "2012-05-26": ((0.8933, 0.9574, 0.9706), (5533, 773)),
    "2012-06-15": ((0.8820, 0.9416, 0.9554), (3321, 742)),
    "2012-08-20": ((0.8749, 0.9463, 0.9618), (5146, 835)),
    "2012-09-28": ((0.8539, 0.9245, 0.9444), (4626, 919)),
    "2012-10-28": ((0.8953, 0.9473, 0.9534), (4623, 1034)),
    "2012-11-16": ((0.8379, 0.8949, 0.9072), (3575, 1290)),
    "2013-02-23": ((0.8667, 0.9154, 0.9238), (4114, 1095)),
    "2013-04-05": ((0.8250, 0.8774, 0.8845), (3341, 1162)),
}


def official(sequence: str) -> Counts:
    arrays = [
        loadmat(OFFICIAL / sequence / f"{n}.mat")[n]
        for n in ("nHits", "nMisses", "nFalseAlarms", "nCorrectRejections")
    ]
    return Counts(*arrays)


def test_precision_recall_and_area_of_six_queries_by_hand() -> None:
    # true positives 1 1 2 2 3 3, false positives 0 1 1 2 2 3, false negatives 3 2 1 1 0 0
    # (test_counts.py)
    precision, recall = precision_recall(count(TOY, NOVELTY, THRESHOLDS))
    np.testing.assert_allclose(precision[0], [1, 1 / 2, 2 / 3, 1 / 2, 3 / 5, 1 / 2])
    np.testing.assert_allclose(recall[0], [1 / 4, 1 / 3, 2 / 3, 2 / 3, 1, 1])
    assert precision.shape == recall.shape == (25, 6)
    # Trapezoids: (1/12)(3/4) + (1/3)(7/12) + 0 + (1/3)(11/20) + 0 = 0.0625 + 0.194444 + 0.183333 =
    # 0.440278
    assert auc(precision, recall)[0] == pytest.approx(0.0625 + 7 / 36 + 11 / 60)
    # With threshold 0 in front, (recall 0, precision 1) joins: one more trapezoid of (1/4) · 1.
    precision, recall = precision_recall(count(TOY, NOVELTY, np.r_[0.0, THRESHOLDS]))
    assert (recall[0, 0], precision[0, 0]) == (0.0, 1.0)
    assert auc(precision, recall)[0] == pytest.approx(0.25 + 0.0625 + 7 / 36 + 11 / 60)
    # By the usual recall a misplaced query counts: 4 are seen; true positives are 1 1 2 2 3 3, and
    # the misplaced one is never recalled.
    precision, recall = precision_recall(count(TOY, NOVELTY, THRESHOLDS), seen=4)
    assert recall[0].tolist() == [1 / 4, 1 / 4, 2 / 4, 2 / 4, 3 / 4, 3 / 4]
    # As by the authors' rule
    np.testing.assert_allclose(precision[0], [1, 1 / 2, 2 / 3, 1 / 2, 3 / 5, 1 / 2])


def test_at_the_ends_of_the_curve() -> None:
    # No seen query at all: 0/0 twice
    precision, recall = precision_recall(Counts(*(np.array([[n]]) for n in (0, 0, 0, 4))))
    assert (precision.item(), recall.item()) == (1.0, 0.0)
    # All accepted: seen but misplaced is a false positive, not a false negative, so there is one
    # true positive, no false negative, one false positive.
    seen = np.array([True, True])
    counts = count(
        GroundTruth(seen, ~seen, np.array([0, -1]), seen),
        np.array([0.1, 0.2], np.float32),
        np.array([1.0]),
        top_n=1,
    )
    precision, recall = precision_recall(counts)
    assert (recall.item(), precision.item()) == (1.0, 0.5)


def exact(
    ground_truth: GroundTruth, novelty: np.ndarray, usual: bool
) -> tuple[np.ndarray, np.ndarray]:
    counts = ExactCounts(ground_truth, novelty, np.ones((1, len(novelty)))).count(1)
    precision, recall = precision_recall(counts, ground_truth.seen.sum() if usual else None)
    return precision[0], recall[0]


def test_where_no_threshold_is_precise_enough_recall_is_zero() -> None:
    # The surest query is wrong: precision never exceeds 1/2, but for the start where nothing is
    # accepted.
    seen = np.array([True, True])
    ground_truth = GroundTruth(seen, ~seen, np.array([1, 0]), seen)
    assert recall_at_precision(*exact(ground_truth, np.array([0.1, 0.2]), usual=False), 0.99) == 0.0


def test_two_hundred_thresholds_come_near_the_exact_curve_and_few_do_not() -> None:
    rng = np.random.default_rng(3)
    seen = rng.random(500) < 0.8
    novelty = (0.5 * rng.random(500) + 0.4 * ~seen).astype(np.float32)
    ground_truth = GroundTruth(seen, ~seen, np.where(seen, rng.integers(0, 2, 500), -1), seen)
    area = auc(*exact(ground_truth, novelty, usual=False))

    def off(thresholds: np.ndarray) -> float:
        return float(
            abs(auc(*precision_recall(count(ground_truth, novelty, thresholds)))[0] - area)
        )

    assert off(np.linspace(0, 1, 200)) < 0.005
    assert off(np.linspace(0, 1, 4)) > 0.01
    # All between the first two of 200 thresholds: the curve is one straight line
    crowded = novelty / 1000
    assert abs(auc(*exact(ground_truth, crowded, usual=False)) - area) < 1e-12
    assert (
        abs(auc(*precision_recall(count(ground_truth, crowded, np.linspace(0, 1, 200))))[0] - area)
        > 0.02
    )


def test_an_unseen_query_more_novel_than_seen_ones_by_hand() -> None:
    # Unseen .4 is above three of the four seen (.1 .2 .3 .6), unseen .7 above all: 7 of 8 pairs.
    assert auroc(ExactCounts(TOY, NOVELTY, np.ones((1, 6))).count(1)).tolist() == [7 / 8]
    # All novelties are equal: every pair is a tie, counting half. Without unseen queries there are
    # no pairs.
    assert auroc(ExactCounts(TOY, np.zeros(6), np.ones((1, 6))).count(1)).tolist() == [0.5]
    assert np.isnan(
        auroc(
            ExactCounts(replace(TOY, unseen=np.zeros(6, bool)), NOVELTY, np.ones((1, 6))).count(1)
        )
    ).all()


QUERIES = st.lists(
    st.tuples(st.booleans(), st.booleans(), st.integers(0, 8)), min_size=2, max_size=40
)


def made(queries: list[tuple[bool, bool, int]]) -> tuple[GroundTruth, np.ndarray]:
    """Queries (seen, right, level of novelty), after one that is seen and right and one that is
    unseen, of the middle level."""
    seen, right, level = (
        np.array(column)
        for column in zip((True, True, 4), (False, False, 4), *queries, strict=True)
    )
    return GroundTruth(seen, ~seen, np.where(seen & right, 0, -1), seen), level / 8


@given(QUERIES)
def test_auroc_is_scikit_learn_s(queries: list[tuple[bool, bool, int]]) -> None:
    ground_truth, novelty = made(queries)
    result = auroc(ExactCounts(ground_truth, novelty, np.ones((1, len(novelty)))).count(1)).item()
    assert result == pytest.approx(metrics.roc_auc_score(ground_truth.unseen, novelty))


@given(QUERIES)
def test_where_every_seen_query_is_right_the_curve_is_scikit_learn_s(
    queries: list[tuple[bool, bool, int]],
) -> None:
    # scikit-learn's recall is of the right answers; those are the seen queries then, by either
    # rule.
    ground_truth, novelty = made([(seen, True, level) for seen, _, level in queries])
    precision, recall, _ = metrics.precision_recall_curve(ground_truth.seen, -novelty)
    for usual in (False, True):
        ours = exact(ground_truth, novelty, usual)
        np.testing.assert_allclose(ours, [precision[::-1], recall[::-1]])
        assert auc(*ours) == pytest.approx(metrics.auc(recall, precision))


@given(QUERIES)
def test_the_best_f1_is_that_of_the_best_threshold(queries: list[tuple[bool, bool, int]]) -> None:
    ground_truth, novelty = made(queries)
    right = ground_truth.true_rank == 0
    best = {False: 0.0, True: 0.0}
    for threshold in (*np.unique(novelty), np.inf):  # rejected from there on
        accepted = novelty < threshold
        true_positives = (accepted & right).sum()
        false_positives = (accepted & ~right).sum()
        false_negatives = (~accepted & ground_truth.seen).sum()
        misplaced = (accepted & ground_truth.seen & ~right).sum()
        for usual in best:
            wanted = true_positives + false_negatives + (misplaced if usual else 0)
            best[usual] = max(
                best[usual],
                2 * true_positives / (true_positives + false_positives + wanted)
                if true_positives
                else 0.0,
            )
    for usual, f1 in best.items():
        assert f1_max(*exact(ground_truth, novelty, usual)) == pytest.approx(f1)


def test_small_unsigned_counts_do_not_overflow() -> None:
    # 80,000 does not fit 16 bits
    counts = Counts(*(np.array([[n]], np.uint16) for n in (60_000, 0, 20_000, 0)))
    assert precision_recall(counts)[0].item() == 0.75


@recorded
@pytest.mark.parametrize("sequence", PUBLISHED)
def test_the_authors_counts_give_the_published_areas(sequence: str) -> None:
    areas, (seen, unseen) = PUBLISHED[sequence]
    counts = official(sequence)
    assert auc(*precision_recall(counts))[[0, 4, 24]] == pytest.approx(areas, abs=1e-4)
    assert (counts.false_negatives[0, 0], counts.true_negatives[0, 0]) == (seen, unseen)


@recorded
def test_the_authors_first_sequence_has_the_accuracy_their_notebook_prints() -> None:
    # Threshold 1 accepts all, so the true positives there are all that are right
    counts = official("2012-02-04")
    assert counts.true_positives[0, -1] / 5170 == pytest.approx(0.82766, abs=1e-5)
