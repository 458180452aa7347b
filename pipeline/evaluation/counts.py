"""Counts of true and false positives and negatives (METHODS.md 2.7).

The SCI paper (Kim, Park and Kim, RA-L 2019) calls true and false positives hits and false alarms,
true and false negatives correct rejections and misses.

In: the ground truth of each query and its novelty. Out: how many queries have each of the four
outcomes at each threshold; `curves` computes precision and recall from them. An answer counts as
right if a true place is among its first n.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.protocols import GroundTruth

TOP_N = 25
"""The largest n: the SCI paper judges the first 1, 5 and 25 places."""
N_THRESHOLDS = 200
"""Number of thresholds of the SCI paper's curve."""


@dataclass(frozen=True)
class Counts:
    """Number of judged queries of each outcome, with the thresholds along the last axis.

    At each threshold the four add up to the number of judged queries.
    """

    true_positives: NDArray[Any]
    """Accepted, and a right answer among the first n."""
    false_negatives: NDArray[Any]
    """Rejected although seen; the same for every n."""
    false_positives: NDArray[Any]
    """Accepted, and no right answer among the first n, or the query unseen."""
    true_negatives: NDArray[Any]
    """Rejected and unseen; the same for every n."""


class ExactCounts:
    """Weighted counts as the threshold rises past every distinct novelty: the exact curve.

    Column 0 rejects all; column i accepts the i smallest distinct novelties. A curve at any other
    thresholds is a subset of these columns.
    """

    def __init__(
        self, ground_truth: GroundTruth, novelty: NDArray[Any], weight: NDArray[np.float64]
    ) -> None:
        """`weight` (r, q): how often each of the q queries counts in each of r resamples."""
        _check(ground_truth, novelty)
        self._ground_truth = ground_truth
        self._order = np.argsort(novelty, kind="stable")
        ascending = np.asarray(novelty, np.float64)[self._order]
        self._distinct = np.unique(ascending)
        self._accepted = np.r_[0, np.searchsorted(ascending, self._distinct, side="right")]
        self._weight = weight[:, self._order]
        self._seen_weight = self._accepted_weight(ground_truth.seen)
        self._unseen_weight = self._accepted_weight(ground_truth.unseen)

    def columns(self, thresholds: NDArray[np.float64]) -> NDArray[np.int64]:
        """For each threshold (t,), the column (t,) with the same accepted queries."""
        return np.searchsorted(self._distinct, thresholds, side="left")

    def count(self, n: int, columns: NDArray[np.int64] | slice = slice(None)) -> Counts:
        """Counts (r, t) among the first `n` answers, in all columns or some."""
        true_positives = self._accepted_weight(is_right_at(self._ground_truth, n))[:, columns]
        accepted_seen = self._seen_weight[:, columns]
        accepted_unseen = self._unseen_weight[:, columns]
        all_seen = self._seen_weight[:, -1:]  # the last column accepts all
        all_unseen = self._unseen_weight[:, -1:]
        return Counts(
            true_positives=true_positives,
            false_negatives=all_seen - accepted_seen,
            false_positives=accepted_seen + accepted_unseen - true_positives,
            true_negatives=all_unseen - accepted_unseen,
        )

    def _accepted_weight(self, flags: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Weight (r, t) of the accepted queries that have the flag (q,), in each column."""
        # The weight of the first i queries, in the order of their novelty, for every i from 0.
        total = np.zeros((len(self._weight), len(flags) + 1))
        np.cumsum(self._weight * flags[self._order], axis=1, out=total[:, 1:])
        return total[:, self._accepted]


def is_right_at(ground_truth: GroundTruth, n: int) -> NDArray[np.bool_]:
    """Whether each query (q,) is seen and has a right answer among its first n."""
    return ground_truth.seen & (ground_truth.true_rank >= 0) & (ground_truth.true_rank < n)


def even_thresholds(novelty: NDArray[Any]) -> NDArray[np.float64]:
    """The N_THRESHOLDS thresholds (t,) at which queries of these novelties (q,) are judged.

    They run in even steps from 0, or the least novelty if that is lower, to 1, or the largest
    finite novelty if that is higher.
    """
    finite = np.asarray(novelty, np.float64)[np.isfinite(novelty)]
    return np.linspace(
        min(0.0, finite.min(initial=0.0)), max(1.0, finite.max(initial=0.0)), N_THRESHOLDS
    )


def _check(ground_truth: GroundTruth, novelty: NDArray[Any]) -> None:
    """Raise InputError unless each query has a ground truth, and a novelty that is not NaN."""
    if (
        not len(ground_truth.true_rank)
        == len(ground_truth.seen)
        == len(ground_truth.unseen)
        == len(novelty)
    ):
        raise InputError(
            f"{len(ground_truth.true_rank)} true ranks, {len(ground_truth.seen)} seen and "
            f"{len(ground_truth.unseen)} unseen flags and {len(novelty)} novelties of the same "
            "queries"
        )
    if np.isnan(novelty).any():
        raise InputError("a query's novelty is NaN, so it can be neither accepted nor rejected")
