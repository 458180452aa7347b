"""How queries fare at every threshold and every top n: the four counts under a precision-recall curve (METHODS.md 2.7)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError

TOP_N = 25
"""Both papers look at the first 1, 5 and 25 places."""
N_THRESHOLDS = 200


@dataclass(frozen=True)
class Counts:
    """Queries of each outcome, all (top_n, threshold); the four add up to the number of queries everywhere."""

    hits: NDArray[np.int64]
    """Accepted, and the true place among the first n."""
    misses: NDArray[np.int64]
    """Rejected although seen; the same for every n."""
    false_alarms: NDArray[np.int64]
    """Accepted, and the true place not among the first n, or the query unseen."""
    correct_rejections: NDArray[np.int64]
    """Rejected and unseen; the same for every n."""


def count(
    true_rank: NDArray[np.int64],
    seen: NDArray[np.bool_],
    novelty: NDArray[np.float32],
    thresholds: NDArray[np.float64],
    top_n: int = TOP_N,
) -> Counts:
    """Counts for n = 1 … `top_n` at each of `thresholds` (t,): a query is rejected iff its novelty ≥ the threshold.

    `true_rank` (q,) is the 0-based rank of a query's true place, −1 if unseen or not ranked; `seen` and `novelty` are (q,).
    """
    if not len(true_rank) == len(seen) == len(novelty):
        raise InputError(f"{len(true_rank)} true ranks, {len(seen)} seen flags and {len(novelty)} novelties of the same queries")
    if np.isnan(novelty).any():
        raise InputError("a query's novelty is NaN, so it can be neither accepted nor rejected")
    rank, known = np.asarray(true_rank), np.asarray(seen, bool)
    rejected = np.asarray(novelty, np.float64)[:, None] >= np.asarray(thresholds, np.float64)  # (q, t)
    right = (rank[:, None] >= 0) & (rank[:, None] < np.arange(1, top_n + 1)) & known[:, None]  # (q, n)
    hits = _tally(right, ~rejected)
    misses = np.broadcast_to(_tally(known[:, None], rejected), hits.shape).copy()
    correct_rejections = np.broadcast_to(_tally(~known[:, None], rejected), hits.shape).copy()
    return Counts(hits, misses, len(rank) - hits - misses - correct_rejections, correct_rejections)


def spread(novelty: NDArray[np.float32]) -> NDArray[np.float64]:
    """The 200 thresholds (t,) to judge these novelties (q,) at.

    0 to 1 where the novelties lie there, as an entropy does; else 0 to the largest one observed, as a distance's do.
    """
    finite = np.asarray(novelty, np.float64)[np.isfinite(novelty)]
    return np.linspace(min(0.0, finite.min(initial=0.0)), max(1.0, finite.max(initial=0.0)), N_THRESHOLDS)


def _tally(rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many queries hold both flags: (q, a), (q, b) to (a, b); the product runs in float64, exact below 2⁵³."""
    return np.rint(rows.T.astype(np.float64) @ columns.astype(np.float64)).astype(np.int64)
