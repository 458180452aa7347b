"""SeqSLAM's two passes over a matrix of differences: contrast, then the cheapest run past each row.

Milford and Wyeth, ICRA 2012; METHODS 6. A row is a reference, a column a query; a run of queries is
laid against the reference at some speeds. Both passes go along the columns, which lie side by side
in memory: a block of them is small enough for the cache, and what is done to one is done to all.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK = 2_048
"""Columns at a time: the dozen rows that a window touches stay in the L2 cache."""
GRAIN = 1_000
"""Speeds are whole thousandths, so that a position is a whole division and no float decides between
two rows."""
FLAT = 1e-13
"""A window whose variance is this share of its mean square or less is flat: float32 cannot tell its
values from each other."""
SAME = {"contract", "nsz"}
"""Fast-math that gives a column the same bits wherever it lies in a block: no reciprocals, which
some processors only guess."""


def contrast(differences: NDArray[np.float32], rows: int) -> NDArray[np.float32]:
    """Differences (n, m) in standard deviations above the mean of their column's window.

    n − 1 in the denominator. The window reaches from rows // 2 above to rows // 2 below, as far as
    there are rows; 0 where it is flat.
    """
    enhanced = np.empty(differences.shape, np.float32)
    _contrast(np.ascontiguousarray(differences, np.float32), rows // 2, enhanced)
    return enhanced


def least(rows: int) -> float:
    """The lowest value of `contrast`: one of the window lies below all others, which are equal."""
    return -2 * (rows // 2) / math.sqrt(2 * (rows // 2) + 1)


def runs(length: int, slowest: float, fastest: float, step: float) -> NDArray[np.int64]:
    """Rows (speed, length + 1) of a run at each speed, in rows a query, from its middle.

    The middle is length // 2 rows after the first whatever the speed: METHODS' rule for which row a
    run matches.
    """
    moves = np.arange(round(GRAIN * slowest), round(GRAIN * fastest) + 1, round(GRAIN * step))
    return np.arange(length + 1) * moves[:, None] // GRAIN - length // 2


def search(
    enhanced: NDArray[np.float32],
    offsets: NDArray[np.int64],
    first: int = 0,
    last: int | None = None,
) -> NDArray[np.float32]:
    """Cost (n, window) of the cheapest run about each row, for windows of queries.

    The windows begin at columns first … last − 1, by default all within the m queries. `offsets`
    are `runs`; a cost is the sum of a run's differences `enhanced` (n, m), +inf where no run about
    the row lies within the reference.
    """
    last = enhanced.shape[1] - offsets.shape[1] + 1 if last is None else last
    costs = np.empty((len(enhanced), max(last - first, 0)), np.float32)
    _search(enhanced, offsets, first, costs)
    return costs


def cheapest(costs: NDArray[np.float32], k: int) -> NDArray[np.int64]:
    """Rows (q, k) of the k cheapest of costs (q, n), cheapest first, then by row."""
    bits = (costs + np.float32(0)).view(np.int32)  # no negative zero
    # whole numbers in the order of the floats
    order = np.where(bits < 0, bits ^ 0x7FFFFFFF, bits).astype(np.int64)
    keys = (order << 32) | np.arange(costs.shape[1])
    k = min(k, keys.shape[1])
    if k < keys.shape[1]:
        keys = np.partition(keys, k - 1, axis=1)[:, :k]
    keys.sort(axis=1)
    return keys & 0xFFFFFFFF


def runner_up(
    costs: NDArray[np.float32], best_row: NDArray[np.int64], window: int
) -> NDArray[np.float32]:
    """The least of costs (q, n) more than window // 2 rows from each best row (q,), else +inf."""
    is_near_best = np.abs(np.arange(costs.shape[1]) - best_row[:, None]) <= window // 2
    other_costs: NDArray[np.float32] = np.where(is_near_best, np.float32(np.inf), costs).min(axis=1)
    return other_costs


@njit(cache=True, nogil=True, fastmath=SAME, boundscheck=False, error_model="numpy")
def _contrast(differences, half, enhanced):  # type: ignore[no-untyped-def]
    """Running sums in float64: in float32 they would be off by up to 0.07."""
    n, m = differences.shape
    for start in range(0, m, BLOCK):
        width = min(start + BLOCK, m) - start
        sums = np.zeros(width)
        squares = np.zeros(width)
        for row in range(-half, n):
            if row + half < n:
                entering = differences[row + half, start : start + width]
                for i in range(width):
                    value = np.float64(entering[i])
                    sums[i] += value
                    squares[i] += value * value
            if row - half > 0:
                leaving = differences[row - half - 1, start : start + width]
                for i in range(width):
                    value = np.float64(leaving[i])
                    sums[i] -= value
                    squares[i] -= value * value
            if row >= 0:
                number = min(row + half, n - 1) - max(row - half, 0) + 1
                _standardised(
                    differences[row, start : start + width],
                    sums,
                    squares,
                    number,
                    enhanced[row, start : start + width],
                )


@njit(cache=True, nogil=True, fastmath=SAME, boundscheck=False, error_model="numpy")
def _standardised(values, sums, squares, number, out):  # type: ignore[no-untyped-def]
    share = 1.0 / number
    unbiased = 1.0 / max(number - 1, 1)
    for i in range(len(out)):
        mean = sums[i] * share
        spread = squares[i] - sums[i] * mean
        flat = spread <= FLAT * squares[i]
        deviation = math.sqrt(np.float32(spread * unbiased if not flat else 1.0))
        above = np.float32(values[i] - mean)
        out[i] = np.float32(0) if flat else above / deviation


@njit(cache=True, nogil=True, fastmath=SAME, boundscheck=False, error_model="numpy")
def _search(enhanced, offsets, start, costs):  # type: ignore[no-untyped-def]
    n, windows = costs.shape
    for block_start in range(0, windows, BLOCK):
        width = min(block_start + BLOCK, windows) - block_start
        total = np.empty(width, np.float32)
        for row in range(n):
            lowest = costs[row, block_start : block_start + width]
            lowest[:] = np.inf
            for run in offsets:
                if row + run.min() < 0 or row + run.max() >= n:
                    continue
                total[:] = 0
                for k in range(len(run)):
                    added = enhanced[
                        row + run[k], start + block_start + k : start + block_start + k + width
                    ]
                    for i in range(width):
                        total[i] += added[i]
                for i in range(width):
                    lowest[i] = min(lowest[i], total[i])
