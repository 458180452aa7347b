"""The numerical kernels of SeqSLAM's search (Milford and Wyeth, ICRA 2012; METHODS 6).

A matrix of differences has a row for each training row (reference) and a column for each query.

1. `enhance_contrast` replaces each difference by its deviation from the differences of the rows
   around it.
2. `search` finds, for each row and each window of consecutive queries, the cheapest run about the
   row. A run aligns the queries with the rows at one of several speeds (`runs`).
3. `cheapest` and `runner_up` read the best rows, and the best row elsewhere, from the costs.

The first two functions go through the matrix row by row, for a block of neighbouring columns at
once, which lie side by side in memory; `matching.sequences` applies them to a whole drive.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK = 2_048
"""How many columns are handled at once: few enough for the dozen rows of a run to stay in the L2
cache."""
GRAIN = 1_000
"""Speeds are rounded to thousandths of a row per query. Positions then follow by a division of
whole numbers, so that no rounding decides between two rows."""
FLAT_SHARE = 1e-13
"""A window is flat if its variance is at most this share of its mean square: float32 cannot tell
its values apart."""
REPRODUCIBLE = {"contract", "nsz"}
"""The fast-math flags under which a column has the same bits wherever it lies in a block. The flag
for reciprocals is missing, since some processors only approximate them."""


def enhance_contrast(differences: NDArray[np.float32], rows: int) -> NDArray[np.float32]:
    """Enhance the contrast of differences (n, m) along each column.

    A difference becomes its deviation from the mean of a window, in standard deviations (sample
    deviations, with one less than the number of rows in the denominator). The window reaches from
    rows // 2 above the difference to rows // 2 below it, cut off at the ends. A flat window gives
    0.
    """
    enhanced = np.empty(differences.shape, np.float32)
    _enhance(np.ascontiguousarray(differences, np.float32), rows // 2, out=enhanced)
    return enhanced


def least_contrast(rows: int) -> float:
    """The lowest value that `enhance_contrast` can give for windows of `rows` rows.

    It is reached where one difference of a window lies below all others, which are equal.
    """
    # With n values, one of them 0 and the rest 1, the mean is (n − 1) / n and the sample
    # variance 1 / n; so the value is −(n − 1) / √n. A window has n = 2 (rows // 2) + 1 rows.
    return -2 * (rows // 2) / math.sqrt(2 * (rows // 2) + 1)


def runs(length: int, slowest: float, fastest: float, step: float) -> NDArray[np.int64]:
    """Rows (speed, length + 1) of a run at each speed, counted from the row that the run matches.

    Speeds go from `slowest` to `fastest` by `step`, in rows per query. Whatever the speed, a run
    matches the row that lies length // 2 rows after its first (METHODS 6, step 5).
    """
    speeds = np.arange(round(GRAIN * slowest), round(GRAIN * fastest) + 1, round(GRAIN * step))
    return np.arange(length + 1) * speeds[:, None] // GRAIN - length // 2


def search(
    enhanced: NDArray[np.float32],
    offsets: NDArray[np.int64],
    first: int = 0,
    last: int | None = None,
) -> NDArray[np.float32]:
    """Costs (n, window) of the cheapest run about each row, for some windows of queries.

    `enhanced` (n, m) are the differences after `enhance_contrast`, `offsets` (speed, length + 1)
    come from `runs`. The windows begin at the columns from `first` to before `last`, by default all
    windows within the m queries. A cost is the sum of a run's differences, +inf if no run about the
    row lies within the n rows.
    """
    if last is None:
        last = enhanced.shape[1] - offsets.shape[1] + 1
    costs = np.empty((len(enhanced), max(last - first, 0)), np.float32)
    _search(enhanced, offsets, first, out_costs=costs)
    return costs


def cheapest(costs: NDArray[np.float32], k: int) -> NDArray[np.int64]:
    """Rows (q, k) of the k lowest costs (q, n), lowest first, and of equal costs the first row.

    Cost and row are packed into one whole number, which is sorted.
    """
    bits = (costs + np.float32(0)).view(np.int32)  # adding 0 makes a negative zero positive
    # Flipping the bits of negative floats gives whole numbers that are ordered as the floats are.
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
    """Lowest cost (q,) of (q, n) over window // 2 rows away from the best row (q,), else +inf."""
    is_near_best = np.abs(np.arange(costs.shape[1]) - best_row[:, None]) <= window // 2
    return np.asarray(np.where(is_near_best, np.float32(np.inf), costs).min(axis=1))


@njit(cache=True, nogil=True, fastmath=REPRODUCIBLE, boundscheck=False, error_model="numpy")
def _enhance(differences, half, out):  # type: ignore[no-untyped-def]
    """Write differences (n, m) to `out` (n, m), standardised over windows of ± `half` rows.

    The window moves down the rows, and its sums are updated by the rows that enter and leave it.
    The sums are float64, since in float32 results would be off by up to 0.07.
    """
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
                    out[row, start : start + width],
                )


@njit(cache=True, nogil=True, fastmath=REPRODUCIBLE, boundscheck=False, error_model="numpy")
def _standardised(values, sums, squares, number, out):  # type: ignore[no-untyped-def]
    """Write the values (width,) of a row in deviations from their windows' means to `out`.

    The windows have `number` rows each. `sums` and `squares` (width,) are the sums of the values
    and of their squares in each window.
    """
    share = 1.0 / number
    unbiased = 1.0 / max(number - 1, 1)
    for i in range(len(out)):
        mean = sums[i] * share
        spread = squares[i] - sums[i] * mean  # the sum of squared deviations
        is_flat = spread <= FLAT_SHARE * squares[i]
        deviation = math.sqrt(np.float32(spread * unbiased if not is_flat else 1.0))
        above_mean = np.float32(values[i] - mean)
        out[i] = np.float32(0) if is_flat else above_mean / deviation


@njit(cache=True, nogil=True, fastmath=REPRODUCIBLE, boundscheck=False, error_model="numpy")
def _search(enhanced, offsets, first, out_costs):  # type: ignore[no-untyped-def]
    """Write the costs of the cheapest runs to `out_costs` (n, windows), from column `first` on."""
    n, windows = out_costs.shape
    for block_start in range(0, windows, BLOCK):
        width = min(block_start + BLOCK, windows) - block_start
        column = first + block_start
        total = np.empty(width, np.float32)
        for row in range(n):
            lowest = out_costs[row, block_start : block_start + width]
            lowest[:] = np.inf
            for run in offsets:
                if row + run.min() < 0 or row + run.max() >= n:
                    continue
                total[:] = 0
                for k in range(len(run)):
                    differences = enhanced[row + run[k], column + k : column + k + width]
                    for i in range(width):
                        total[i] += differences[i]
                for i in range(width):
                    lowest[i] = min(lowest[i], total[i])
