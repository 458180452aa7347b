"""SeqSLAM's search (METHODS 6): differences of queries from training rows in; costs of rows out.

A run is a few queries one after the other, laid along training rows at one speed. The cost of a row
for a query is the sum of differences over the best run in which the query drives past that row. The
steps of the search are `sequence`'s; here they are applied to all queries of a sequence, also at
either end of it, and where there are few queries or rows.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, Positive, Whole, check
from pipeline.matching.sequence import GRAIN, contrast, least, runner_up, runs, search

QUERIES = 256
"""Queries searched at once: the costs of all rows for all queries may not fit into memory."""
LARGEST = float(np.finfo(np.float32).max)
Costs = NDArray[np.float32]
"""(query, row)."""


@dataclass(frozen=True)
class Alignment:
    """Settings of the search."""

    length: Count = 10
    """Steps of a run, which has one query more."""
    slowest: Positive = 0.8
    """Training rows a query."""
    fastest: float = 1.2
    """Training rows a query."""
    speed_step: float = 0.1
    """From one speed that is tried to the next."""
    both_ways: bool = False
    """Whether runs may drive the training sequence backwards too; the authors' do not."""
    contrast_rows: Whole = 30
    """A difference counts in relation to those of so many training rows around its own."""
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
        # what costs count from
        self.base = np.float32(lowest * (settings.length + 1) if settings.subtract_minimum else 0)

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Costs]]:
        """Blocks of queries (q,), with their costs (q, n) of the rows; +inf where no run passes."""
        m = self.shape[1]
        forward = runs(
            self.length, self.settings.slowest, self.settings.fastest, self.settings.speed_step
        )
        half = self.length // 2
        for start in range(0, max(m, 1), QUERIES):
            queries = np.arange(start, min(start + QUERIES, m))
            # A window is the queries of a run; the query is its middle one, but at either end.
            windows = np.clip(queries - half, 0, max(m - 1 - self.length, 0))
            behind_middle = queries - half - windows
            sums = self._past(forward, windows, behind_middle)
            if self.settings.both_ways:
                sums = np.minimum(sums, self._past(-forward, windows, -behind_middle))
            yield queries, sums * self.scale

    def _past(
        self,
        offsets: NDArray[np.int64],
        windows: NDArray[np.int64],
        behind_middle: NDArray[np.int64],
    ) -> Costs:
        """The sums (q, n) of the best run of each window (q,), by the row that the query passes.

        A window is named by its first query. `offsets` are the rows of a run from its middle, for
        each speed. The query comes `behind_middle` (q,) queries after the window's middle one.
        """
        if not len(windows):
            return np.empty((0, len(self.enhanced)), np.float32)
        sums_at_middle = search(self.enhanced, offsets, int(windows[0]), int(windows[-1]) + 1)
        sums: Costs = np.ascontiguousarray(sums_at_middle.T)[windows - windows[0]]
        for query in np.flatnonzero(behind_middle):
            shift = behind_middle[query]
            sums[query] = np.roll(sums[query], shift)
            sums[query, : max(shift, 0)] = np.inf
            sums[query, len(sums[query]) + min(shift, 0) :] = np.inf
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
