"""A run of queries laid along the training rows at the speed that fits best: SeqSLAM's search for a
whole sequence (METHODS 6).

The same for every number of queries and rows: at either end of the queries, and where there are too
few of either.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.matching.sequence import GRAIN, contrast, least, runner_up, runs, search
from pipeline.running.settings import Count, Positive, Whole, check

QUERIES = 256  # searched at once, so that no cost of every row with every query is kept
LARGEST = float(np.finfo(np.float32).max)
Costs = NDArray[np.float32]


@dataclass(frozen=True)
class Alignment:
    """How sequences are searched; a sequence is `length` + 1 queries."""

    length: Count = 10
    slowest: Positive = 0.8
    fastest: float = 1.2
    speed_step: float = 0.1  # speeds are training rows a query
    both_ways: bool = False  # match the training sequence driven backwards too; the authors do not
    contrast_rows: Whole = (
        30  # a difference counts against those of so many training rows around its own
    )
    subtract_minimum: bool = True
    """Costs count from the least enhanced difference, as in SeqSLAM; paper 2's code leaves that
    out, and costs below 0 turn its score round."""

    def __post_init__(self) -> None:
        check(self, "method")
        if self.speed_step * GRAIN < 1:
            raise ConfigError(f"method.speed_step={self.speed_step}: expected {1 / GRAIN} or more")
        if self.fastest < self.slowest:
            raise ConfigError(
                f"method.fastest={self.fastest}: expected at least slowest={self.slowest}"
            )
        if self.contrast_rows < 2:
            raise ConfigError(f"method.contrast_rows={self.contrast_rows}: expected 2 or more")


class Aligned:
    """A sequence of m queries held against all n rows by their differences (n, m), and what its
    costs say.

    Raises InputError where those are not finite.
    """

    def __init__(self, how: Alignment, differences: NDArray[np.float32]) -> None:
        n, m = differences.shape
        self.how = how
        self.shape = (n, m)
        self.length = max(min(how.length, m - 1, int((n - 1) / max(how.slowest, 1))), 0)
        self.enhanced = contrast(differences, how.contrast_rows)
        self.scale = np.float32((how.length + 1) / (self.length + 1))
        lowest = float(self.enhanced.min(initial=0))
        if not math.isfinite(lowest):
            raise InputError("differences between queries and rows: expected finite numbers")
        if m <= how.length:  # too few for their own least to say anything
            lowest = least(how.contrast_rows)
        self.base = np.float32(lowest * (how.length + 1) if how.subtract_minimum else 0)

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Costs]]:
        """Some queries (q,), and the summed differences (q, n) of the best run past each row; +inf
        where none is."""
        m = self.shape[1]
        forward = runs(self.length, self.how.slowest, self.how.fastest, self.how.speed_step)
        half = self.length // 2
        for first in range(0, max(m, 1), QUERIES):
            queries = np.arange(first, min(first + QUERIES, m))
            windows = np.clip(queries - half, 0, max(m - 1 - self.length, 0))
            late = (
                queries - half - windows
            )  # how far a query at an end lies behind the middle of its window
            sums = self._past(forward, windows, late)
            if self.how.both_ways:
                sums = np.minimum(sums, self._past(-forward, windows, -late))
            yield queries, sums * self.scale

    def _past(
        self, offsets: NDArray[np.int64], windows: NDArray[np.int64], late: NDArray[np.int64]
    ) -> Costs:
        """Of windows (q,), by the row that the query `late` (q,) rows behind their middles drove
        past."""
        if not len(windows):
            return np.empty((0, len(self.enhanced)), np.float32)
        middle = search(self.enhanced, offsets, int(windows[0]), int(windows[-1]) + 1)
        sums: Costs = np.ascontiguousarray(middle.T)[windows - windows[0]]
        for query in np.flatnonzero(late):
            sums[query] = np.roll(sums[query], late[query])
            sums[query, : max(late[query], 0)] = np.inf
            sums[query, len(sums[query]) + min(late[query], 0) :] = np.inf
        return sums

    def novelty(self, sums: Costs, best: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """Each kind (q,), of sums (q, n) with their best row (q,).

        The cost is that before the least difference is taken off: taking it off would leave the
        order of one call's queries as it is, but make the costs of two calls, and so a threshold,
        incomparable.
        """
        cost = np.take_along_axis(sums, best[:, None], axis=1)[:, 0].astype(np.float64)
        other = runner_up(sums, best, self.how.length) - float(self.base)
        defined = np.isfinite(other) & (other > 0)
        ratio = np.divide(cost - float(self.base), other, out=np.ones_like(cost), where=defined)
        if not self.how.subtract_minimum:
            with np.errstate(divide="ignore"):
                cost = -np.minimum(1 / cost, 1)
        return {
            "cost": np.clip(cost, -LARGEST, LARGEST),
            "ratio": np.clip(ratio, -LARGEST, LARGEST),
        }
