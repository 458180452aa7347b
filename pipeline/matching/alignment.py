"""SeqSLAM's search for a whole sequence: queries laid along training rows at the best speed.

METHODS 6. The same for every number of queries and rows: at either end of the queries, and where
there are too few of either.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, Positive, Whole, check
from pipeline.matching.sequence import GRAIN, contrast, least, runner_up, runs, search

QUERIES = 256  # searched at once, so that no cost of every row with every query is kept
LARGEST = float(np.finfo(np.float32).max)
Costs = NDArray[np.float32]


@dataclass(frozen=True)
class Alignment:
    """Settings of the search for sequences; a sequence is `length` + 1 queries."""

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
    """A sequence of m queries compared with all n rows, by their differences (n, m).

    Raises InputError where those are not finite.
    """

    def __init__(self, settings: Alignment, differences: NDArray[np.float32]) -> None:
        n, m = differences.shape
        self.settings = settings
        self.shape = (n, m)
        self.length = max(min(settings.length, m - 1, int((n - 1) / max(settings.slowest, 1))), 0)
        self.enhanced = contrast(differences, settings.contrast_rows)
        self.scale = np.float32((settings.length + 1) / (self.length + 1))
        lowest = float(self.enhanced.min(initial=0))
        if not math.isfinite(lowest):
            raise InputError("differences between queries and rows: expected finite numbers")
        if m <= settings.length:  # too few for their own least to say anything
            lowest = least(settings.contrast_rows)
        self.base = np.float32(lowest * (settings.length + 1) if settings.subtract_minimum else 0)

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Costs]]:
        """Blocks of queries (q,) with the summed differences (q, n) of the best run past each row.

        +inf where there is no run.
        """
        m = self.shape[1]
        forward = runs(
            self.length, self.settings.slowest, self.settings.fastest, self.settings.speed_step
        )
        half = self.length // 2
        for start in range(0, max(m, 1), QUERIES):
            queries = np.arange(start, min(start + QUERIES, m))
            windows = np.clip(queries - half, 0, max(m - 1 - self.length, 0))
            late = (
                queries - half - windows
            )  # how far a query at an end lies behind the middle of its window
            sums = self._past(forward, windows, late)
            if self.settings.both_ways:
                sums = np.minimum(sums, self._past(-forward, windows, -late))
            yield queries, sums * self.scale

    def _past(
        self, offsets: NDArray[np.int64], windows: NDArray[np.int64], late: NDArray[np.int64]
    ) -> Costs:
        """Sums (q, n) of windows (q,), by the row that the query drove past.

        The query is `late` (q,) rows behind the middle of its window.
        """
        if not len(windows):
            return np.empty((0, len(self.enhanced)), np.float32)
        middle = search(self.enhanced, offsets, int(windows[0]), int(windows[-1]) + 1)
        sums: Costs = np.ascontiguousarray(middle.T)[windows - windows[0]]
        for query in np.flatnonzero(late):
            sums[query] = np.roll(sums[query], late[query])
            sums[query, : max(late[query], 0)] = np.inf
            sums[query, len(sums[query]) + min(late[query], 0) :] = np.inf
        return sums

    def novelty(self, sums: Costs, best_row: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """Each kind of novelty (q,), of sums (q, n) with their best row (q,).

        The cost is that before the least difference is taken off: taking it off would leave the
        order of one call's queries as it is, but make the costs of two calls, and so a threshold,
        incomparable.
        """
        cost = np.take_along_axis(sums, best_row[:, None], axis=1)[:, 0].astype(np.float64)
        runner_up_cost = runner_up(sums, best_row, self.settings.length) - float(self.base)
        defined = np.isfinite(runner_up_cost) & (runner_up_cost > 0)
        ratio = np.divide(
            cost - float(self.base), runner_up_cost, out=np.ones_like(cost), where=defined
        )
        if not self.settings.subtract_minimum:
            with np.errstate(divide="ignore"):
                cost = -np.minimum(1 / cost, 1)
        return {
            "cost": np.clip(cost, -LARGEST, LARGEST),
            "ratio": np.clip(ratio, -LARGEST, LARGEST),
        }
