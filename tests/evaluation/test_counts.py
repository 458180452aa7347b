"""Tests of the counts of true and false positives and negatives (METHODS.md 2.7)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.core.errors import InputError
from pipeline.evaluation.counts import ExactCounts, even_thresholds
from pipeline.evaluation.protocols import GroundTruth
from tests.evaluation.made import NOVELTY, THRESHOLDS, TOY, count


def cells(true_rank: np.ndarray, seen: np.ndarray) -> GroundTruth:
    return GroundTruth(seen, ~seen, true_rank, np.zeros_like(seen))


def test_counts_of_six_queries_by_hand() -> None:
    # τ .15: only query 0 is accepted, a true positive; seen 1, 2, 4 are missed and unseen 3, 5
    # rejected. τ 1: all six are accepted, seen 0, 2, 4 right, seen 1 misplaced, unseen 3 and 5
    # accepted. The rows between follow METHODS.md 2.7.
    counts = count(TOY, NOVELTY, THRESHOLDS, top_n=3)
    assert counts.true_positives.shape == (3, 6)
    assert counts.true_positives[0].tolist() == [1, 1, 2, 2, 3, 3]
    assert counts.false_positives[0].tolist() == [0, 1, 1, 2, 2, 3]
    assert counts.false_negatives[0].tolist() == [3, 2, 1, 1, 0, 0]
    assert counts.true_negatives[0].tolist() == [2, 2, 2, 1, 1, 0]
    # Query 1's true place is its second answer: from top-2 on it is a true positive wherever it is
    # accepted (τ > .2).
    assert (
        counts.true_positives[1].tolist() == counts.true_positives[2].tolist() == [1, 2, 3, 3, 4, 4]
    )
    assert counts.false_negatives[1].tolist() == counts.false_negatives[0].tolist()


def test_a_query_at_the_threshold_is_rejected_and_an_unseen_one_never_a_hit() -> None:
    counts = count(
        cells(np.array([0]), np.array([True])),
        np.array([0.25], np.float32),
        np.array([0.25, 0.26]),
        top_n=1,
    )
    assert (counts.false_negatives.tolist(), counts.true_positives.tolist()) == ([[1, 0]], [[0, 1]])
    counts = count(
        cells(np.array([0]), np.array([False])),
        np.array([0.1], np.float32),
        np.array([0.5]),
        top_n=1,
    )
    assert (counts.true_positives.item(), counts.false_positives.item()) == (0, 1)


def test_every_query_has_one_outcome_at_every_threshold() -> None:
    rng = np.random.default_rng(0)
    seen = rng.random(300) < 0.7
    counts = count(
        cells(np.where(seen, rng.integers(-1, 40, 300), -1), seen),
        rng.random(300, np.float32),
        np.linspace(0, 1, 200),
    )
    total = (
        counts.true_positives
        + counts.false_negatives
        + counts.false_positives
        + counts.true_negatives
    )
    assert counts.true_positives.shape == (25, 200)
    assert (total == 300).all()
    # At threshold 0 everything is rejected: Table II's seen …
    assert counts.false_negatives[0, 0] == seen.sum()
    assert counts.true_negatives[0, 0] == (~seen).sum()  # … and unseen


def test_a_query_neither_seen_nor_unseen_is_in_no_count() -> None:
    ground_truth = GroundTruth(
        np.array([True, False, False]),
        np.array([False, True, False]),
        np.array([0, -1, -1]),
        np.zeros(3, bool),
    )
    novelty = np.array([0.1, 0.2, 0.3], np.float32)
    counts = count(ground_truth, novelty, np.array([0.0, 1.0]), top_n=1)
    result = [
        a[0].tolist()
        for a in (
            counts.true_positives,
            counts.false_negatives,
            counts.false_positives,
            counts.true_negatives,
        )
    ]
    # All rejected, all accepted: two queries each time
    assert result == [
        [0, 1],
        [1, 0],
        [0, 1],
        [1, 0],
    ]
    swept = ExactCounts(ground_truth, novelty, np.ones((1, 3))).count(1)
    assert swept.true_positives.tolist() == [[0, 1, 1, 1]]
    assert swept.false_positives.tolist() == [[0, 0, 1, 1]]


def test_a_sweep_accepts_one_distinct_novelty_after_another() -> None:
    # Novelties .1 .2 .2 .5 in another order: columns reject all, accept .1, accept both .2 at once,
    # accept all.
    ground_truth = cells(np.array([0, -1, 0, 0]), np.array([True, False, True, True]))
    exact = ExactCounts(ground_truth, np.array([0.2, 0.2, 0.5, 0.1], np.float32), np.ones((1, 4)))
    counts = exact.count(1)
    assert counts.true_positives.tolist() == [[0, 1, 2, 3]]
    assert counts.false_negatives.tolist() == [[3, 2, 1, 0]]
    assert counts.false_positives.tolist() == [[0, 0, 1, 1]]
    assert counts.true_negatives.tolist() == [[1, 1, 0, 0]]
    assert exact.columns(np.array([0.0, 0.1, 0.15, 0.3, 0.5, 0.6])).tolist() == [0, 0, 1, 2, 2, 3]


@given(st.lists(st.tuples(st.integers(-1, 6), st.booleans(), st.integers(0, 12)), max_size=30))
def test_a_sweep_with_weights_of_one_counts_as_the_authors_do(
    queries: list[tuple[int, bool, int]],
) -> None:
    rank, seen, level = (
        (np.array(column) for column in zip(*queries, strict=True))
        if queries
        else np.zeros((3, 0), int)
    )
    ground_truth = cells(rank, seen.astype(bool))
    novelty = (level / 12).astype(np.float32)
    thresholds = np.linspace(0, 1, 25)
    counts = count(ground_truth, novelty, thresholds, top_n=5)
    exact = ExactCounts(ground_truth, novelty, np.ones((1, len(queries))))
    for n in (1, 5):
        swept = exact.count(n, exact.columns(thresholds))
        for name, column in vars(counts).items():
            assert vars(swept)[name].tolist() == [column[n - 1].tolist()], name


def test_no_queries_give_empty_counts() -> None:
    counts = count(
        cells(np.array([], np.int64), np.array([], bool)), np.array([], np.float32), np.array([0.5])
    )
    assert counts.true_positives.shape == (25, 1)
    assert not counts.true_positives.any()


def test_a_novelty_that_is_no_number_and_arrays_of_different_queries_are_refused() -> None:
    one = cells(np.array([0]), np.array([True]))
    with pytest.raises(InputError, match="NaN"):
        ExactCounts(one, np.array([np.nan], np.float32), np.ones((1, 1)))
    two_ranks = cells(np.array([0, 0]), np.array([True]))
    with pytest.raises(InputError, match="2 true ranks, 1 seen"):
        ExactCounts(two_ranks, np.array([0.1], np.float32), np.ones((1, 1)))


def test_thresholds_span_an_entropy_s_range_or_the_distances_seen() -> None:
    assert (
        even_thresholds(np.array([0.2, 0.4], np.float32)).tolist()
        == np.linspace(0, 1, 200).tolist()
    )
    distances = even_thresholds(np.array([0.2, 3.5, np.inf], np.float32))
    assert (len(distances), distances[0], distances[-1]) == (200, 0.0, 3.5)
