"""Counts of hits, misses, false alarms and correct rejections (METHODS.md 2.7).

In: the truth of each query and its novelty. Out: how many queries have each of the four outcomes at
each threshold; `curves` computes precision and recall from them. An answer counts as right if a
true place is among its first n.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.protocols import Truth

TOP_N = 25
"""The largest n: the SCI paper judges the first 1, 5 and 25 places."""
N_THRESHOLDS = 200
"""Number of thresholds of the SCI paper's curve."""


@dataclass(frozen=True)
class Counts:
    """Number of judged queries of each outcome, with the thresholds along the last axis.

    At each threshold the four add up to the number of judged queries.
    """

    hits: NDArray[Any]
    """Accepted, and a right answer among the first n."""
    misses: NDArray[Any]
    """Rejected although seen; the same for every n."""
    false_alarms: NDArray[Any]
    """Accepted, and no right answer among the first n, or the query unseen."""
    correct_rejections: NDArray[Any]
    """Rejected and unseen; the same for every n."""


class ExactCounts:
    """Weighted counts as the threshold rises past every distinct novelty: the exact curve.

    Column 0 rejects all; column i accepts the i smallest distinct novelties. A curve at any other
    thresholds is a subset of these columns.
    """

    def __init__(self, truth: Truth, novelty: NDArray[Any], weight: NDArray[np.float64]) -> None:
        """`weight` (r, q): how often each of the q queries counts in each of r resamples."""
        _check(truth, novelty)
        self._truth = truth
        self._order = np.argsort(novelty, kind="stable")
        ascending = np.asarray(novelty, np.float64)[self._order]
        self._distinct = np.unique(ascending)
        self._accepted = np.r_[0, np.searchsorted(ascending, self._distinct, side="right")]
        self._weight = weight[:, self._order]
        self._seen_weight = self._accepted_weight(truth.seen)
        self._unseen_weight = self._accepted_weight(truth.unseen)

    def columns(self, thresholds: NDArray[np.float64]) -> NDArray[np.int64]:
        """For each threshold (t,), the column (t,) with the same accepted queries."""
        return np.searchsorted(self._distinct, thresholds, side="left")

    def count(self, n: int, columns: NDArray[np.int64] | slice = slice(None)) -> Counts:
        """Counts (r, t) among the first `n` answers, in all columns or some."""
        hits = self._accepted_weight(is_right_at(self._truth, n))[:, columns]
        accepted_seen = self._seen_weight[:, columns]
        accepted_unseen = self._unseen_weight[:, columns]
        return Counts(
            hits=hits,
            misses=self._seen_weight[:, -1:] - accepted_seen,  # the last column accepts all
            false_alarms=accepted_seen + accepted_unseen - hits,
            correct_rejections=self._unseen_weight[:, -1:] - accepted_unseen,
        )

    def _accepted_weight(self, flags: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Weight (r, t) of the accepted queries that have the flag (q,), in each column."""
        # The weight of the first i queries, in the order of their novelty, for every i from 0.
        total = np.zeros((len(self._weight), len(flags) + 1))
        np.cumsum(self._weight * flags[self._order], axis=1, out=total[:, 1:])
        return total[:, self._accepted]


def is_right_at(truth: Truth, n: int) -> NDArray[np.bool_]:
    """Whether each query (q,) is seen and has a right answer among its first n."""
    return truth.seen & (truth.true_rank >= 0) & (truth.true_rank < n)


def even_thresholds(novelty: NDArray[Any]) -> NDArray[np.float64]:
    """The N_THRESHOLDS thresholds (t,) at which queries of these novelties (q,) are judged.

    They run in even steps from 0, or the least novelty if that is lower, to 1, or the largest
    finite novelty if that is higher.
    """
    finite = np.asarray(novelty, np.float64)[np.isfinite(novelty)]
    return np.linspace(
        min(0.0, finite.min(initial=0.0)), max(1.0, finite.max(initial=0.0)), N_THRESHOLDS
    )


def _check(truth: Truth, novelty: NDArray[Any]) -> None:
    """Raise InputError unless each query has a truth, and a novelty that is not NaN."""
    if not len(truth.true_rank) == len(truth.seen) == len(truth.unseen) == len(novelty):
        raise InputError(
            f"{len(truth.true_rank)} true ranks, {len(truth.seen)} seen and {len(truth.unseen)} "
            f"unseen flags and {len(novelty)} novelties of the same queries"
        )
    if np.isnan(novelty).any():
        raise InputError("a query's novelty is NaN, so it can be neither accepted nor rejected")
