"""SeqSLAM's search over a whole drive (METHODS 6): differences between queries and training rows
in, the cost of every row for every query out.

A run lays consecutive queries along the training rows at one speed. A row's cost for a query is the
sum of differences over the cheapest run in which the query drives past that row.

1. Enhance the contrast of each difference against those of the rows around it.
2. Take the window of `length` + 1 queries around each query; near the ends of the drive, the
   first or the last window.
3. In each window find the cheapest run past each row, over all speeds (and both ways, if wanted).
4. Derive from the costs how new each query is.

The numerical kernels of these steps are in `matching.sequence`.
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
MAX_NOVELTY = float(np.finfo(np.float32).max)
"""Bound of a novelty, which is stored as float32."""
Costs = NDArray[np.float32]
"""Costs (query, row) of training rows for queries."""


@dataclass(frozen=True)
class Alignment:
    """Settings of the search; a subclass is a method (`matching.sequences`)."""

    length: Count = 10
    """Steps of a run: it has `length` + 1 queries."""
    slowest: Positive = 0.8
    """Lowest speed tried, in training rows per query."""
    fastest: float = 1.2
    """Highest speed tried, in training rows per query."""
    speed_step: float = 0.1
    """Step between the speeds tried, in training rows per query."""
    both_ways: bool = False
    """Whether runs may also drive the training sequence backwards; the authors' do not."""
    contrast_rows: Whole = 30
    """Width of the window of training rows in which contrast is enhanced."""
    subtract_minimum: bool = True
    """Whether costs are counted from the least enhanced difference, so that none is negative, as in
    SeqSLAM. Paper 2's code leaves this out, and where its costs are negative its score is reversed.
    """

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


class AlignedQueries:
    """The m queries of a drive, aligned with all n training rows."""

    base: np.float32
    """The least cost that a run can have here; it is subtracted from costs before they are ranked.
    0 unless `subtract_minimum`."""

    def __init__(self, settings: Alignment, differences: NDArray[np.float32]) -> None:
        """Enhance the `differences` (n, m); raises InputError where they are not finite."""
        n, m = differences.shape
        self.settings = settings
        self.n_queries = m
        # Too few queries or rows get a shorter run, whose sums are scaled up to the full length.
        # At the lowest speed that is tried, but at least one row per query, a run of `max_steps`
        # still fits into the n rows.
        max_steps = int((n - 1) / max(settings.slowest, 1))
        self.length = max(min(settings.length, m - 1, max_steps), 0)
        self.scale = np.float32((settings.length + 1) / (self.length + 1))
        self.enhanced = contrast(differences, settings.contrast_rows)
        lowest = float(self.enhanced.min(initial=0))
        if not math.isfinite(lowest):
            raise InputError("differences between queries and rows: expected finite numbers")
        if m <= settings.length:
            # The minimum over so few queries says little: the lowest possible value is taken.
            lowest = least(settings.contrast_rows)
        self.base = np.float32(lowest * (settings.length + 1) if settings.subtract_minimum else 0)

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Costs]]:
        """Yield blocks of queries (q,), each with the costs (q, n) of all rows.

        A cost is +inf where no run passes the row.
        """
        m = self.n_queries
        forward = runs(
            self.length, self.settings.slowest, self.settings.fastest, self.settings.speed_step
        )
        half_length = self.length // 2
        for start in range(0, max(m, 1), QUERIES):
            queries = np.arange(start, min(start + QUERIES, m))
            # A query is the middle one of its window, except near either end of the drive.
            window_starts = np.clip(queries - half_length, 0, max(m - 1 - self.length, 0))
            after_middle = queries - half_length - window_starts
            sums = self._cheapest_past_rows(forward, window_starts, after_middle)
            if self.settings.both_ways:
                # Backwards, a later query passes an earlier row.
                backward_sums = self._cheapest_past_rows(-forward, window_starts, -after_middle)
                sums = np.minimum(sums, backward_sums)
            yield queries, sums * self.scale

    def _cheapest_past_rows(
        self,
        offsets: NDArray[np.int64],
        window_starts: NDArray[np.int64],
        after_middle: NDArray[np.int64],
    ) -> Costs:
        """Sums (q, n) of differences over the cheapest run in which each query passes each row.

        `offsets` (speed, length + 1) are the rows of a run, counted from its middle row.
        `window_starts` (q,) are the first queries of the windows, rising. `after_middle` (q,) is
        how many rows after the one at the middle of its window each query passes.
        """
        if not len(window_starts):
            return np.empty((0, len(self.enhanced)), np.float32)
        first = int(window_starts[0])
        sums_at_middle = search(self.enhanced, offsets, first, int(window_starts[-1]) + 1)
        sums: Costs = np.ascontiguousarray(sums_at_middle.T)[window_starts - first]
        # At one row per query, a query so many steps after the middle passes the row so many rows
        # further on; the rows at the ends that no run reaches so get an infinite sum.
        for query in np.flatnonzero(after_middle):
            rows_further = after_middle[query]
            sums[query] = np.roll(sums[query], rows_further)
            sums[query, : max(rows_further, 0)] = np.inf
            sums[query, len(sums[query]) + min(rows_further, 0) :] = np.inf
        return sums

    def novelty(self, sums: Costs, best_row: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
        """Return both kinds of novelty (q,) of queries with costs `sums` (q, n).

        `cost` is the cost of the best row (q,), `ratio` is that cost over the lowest one more than
        half a run away. For `cost` the least difference is not subtracted: it differs from drive to
        drive, and a threshold must suit all of them.
        """
        cost = np.take_along_axis(sums, best_row[:, None], axis=1)[:, 0].astype(np.float64)
        runner_up_cost = runner_up(sums, best_row, self.settings.length) - float(self.base)
        has_ratio = np.isfinite(runner_up_cost) & (runner_up_cost > 0)
        ratio = np.ones_like(cost)
        np.divide(cost - float(self.base), runner_up_cost, out=ratio, where=has_ratio)
        if not self.settings.subtract_minimum:
            # Paper 2's score is one over the cost, at most 1.
            with np.errstate(divide="ignore"):
                cost = -np.minimum(1 / cost, 1)
        return {
            "cost": np.clip(cost, -MAX_NOVELTY, MAX_NOVELTY),
            "ratio": np.clip(ratio, -MAX_NOVELTY, MAX_NOVELTY),
        }
