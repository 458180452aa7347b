"""Precision, recall and AUC: by hand, and against the SCI authors' published counts."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from pipeline.evaluation.counts import Counts, count
from pipeline.evaluation.curves import auc, precision_recall

# The toy of METHODS.md 2.7: six queries, the second of them placed wrong (its true place is ranked second).
NOVELTY = np.array([0.1, 0.2, 0.3, 0.4, 0.6, 0.7], np.float32)
SEEN = np.array([1, 1, 1, 0, 1, 0], bool)
TRUE_RANK = np.array([0, 1, 0, -1, 0, -1])
THRESHOLDS = np.array([0.15, 0.25, 0.35, 0.5, 0.65, 1.0])

OFFICIAL = Path(__file__).parents[2].parent / "shared" / "real" / "nclt" / "official_sci_counts"
recorded = pytest.mark.skipif(not OFFICIAL.is_dir(), reason=f"the SCI authors' published counts are not at {OFFICIAL}")

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
    arrays = [loadmat(OFFICIAL / sequence / f"{n}.mat")[n] for n in ("nHits", "nMisses", "nFalseAlarms", "nCorrectRejections")]
    return Counts(*arrays)


def test_precision_and_recall_of_six_queries_by_hand() -> None:
    # hits 1 1 2 2 3 3, false alarms 0 1 1 2 2 3, misses 3 2 1 1 0 0 (test_counts.py)
    precision, recall = precision_recall(count(TRUE_RANK, SEEN, NOVELTY, THRESHOLDS))
    np.testing.assert_allclose(precision[0], [1, 1 / 2, 2 / 3, 1 / 2, 3 / 5, 1 / 2])
    np.testing.assert_allclose(recall[0], [1 / 4, 1 / 3, 2 / 3, 2 / 3, 1, 1])
    assert precision.shape == recall.shape == (25, 6)


def test_area_of_six_queries_by_hand() -> None:
    # Trapezoids: (1/12)(3/4) + (1/3)(7/12) + 0 + (1/3)(11/20) + 0 = 0.0625 + 0.194444 + 0.183333 = 0.440278
    precision, recall = precision_recall(count(TRUE_RANK, SEEN, NOVELTY, THRESHOLDS))
    assert auc(precision, recall)[0] == pytest.approx(0.0625 + 7 / 36 + 11 / 60)
    # With threshold 0 in front, (recall 0, precision 1) joins: one more trapezoid of (1/4) · 1.
    precision, recall = precision_recall(count(TRUE_RANK, SEEN, NOVELTY, np.r_[0.0, THRESHOLDS]))
    assert (recall[0, 0], precision[0, 0]) == (0.0, 1.0)
    assert auc(precision, recall)[0] == pytest.approx(0.25 + 0.0625 + 7 / 36 + 11 / 60)


def test_where_nothing_is_accepted_precision_is_one_and_recall_zero() -> None:
    precision, recall = precision_recall(Counts(*(np.array([[n]]) for n in (0, 0, 0, 4))))  # no seen query at all: 0/0 twice
    assert (precision.item(), recall.item()) == (1.0, 0.0)


def test_recall_reaches_one_when_everything_is_accepted_though_places_are_wrong() -> None:
    # Seen and accepted but misplaced is a false alarm, not a miss: one hit, no miss, one false alarm.
    counts = count(np.array([0, -1]), np.array([True, True]), np.array([0.1, 0.2], np.float32), np.array([1.0]), top_n=1)
    precision, recall = precision_recall(counts)
    assert (recall.item(), precision.item()) == (1.0, 0.5)


def test_small_unsigned_counts_do_not_overflow() -> None:
    counts = Counts(*(np.array([[n]], np.uint16) for n in (60_000, 0, 20_000, 0)))  # 80,000 does not fit 16 bits
    assert precision_recall(counts)[0].item() == 0.75


@recorded
@pytest.mark.parametrize("sequence", PUBLISHED)
def test_the_authors_counts_give_the_published_areas(sequence: str) -> None:
    areas, (seen, unseen) = PUBLISHED[sequence]
    counts = official(sequence)
    assert auc(*precision_recall(counts))[[0, 4, 24]] == pytest.approx(areas, abs=1e-4)
    assert (counts.misses[0, 0], counts.correct_rejections[0, 0]) == (seen, unseen)


@recorded
def test_the_authors_counts_give_the_published_means() -> None:
    areas = np.array([auc(*precision_recall(official(sequence)))[[0, 4, 24]] for sequence in PUBLISHED])
    assert areas.mean(axis=0) == pytest.approx((0.8792, 0.9353, 0.9462), abs=1e-4)
    assert areas.std(axis=0) == pytest.approx((0.0338, 0.0305, 0.0302), abs=1e-4)


@recorded
def test_the_authors_first_sequence_has_the_accuracy_their_notebook_prints() -> None:
    counts = official("2012-02-04")  # threshold 1 accepts all, so the hits there are all that are right
    assert counts.hits[0, -1] / 5170 == pytest.approx(0.82766, abs=1e-5)
