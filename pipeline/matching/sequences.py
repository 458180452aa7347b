"""Base of PFL, AFL and SAD, which match sequences of queries with sequences of training rows.

A method computes the differences between a drive's queries and the training rows; SeqSLAM's search
(METHODS 6) with paper 2's settings and scores (METHODS 5.5) makes a ranking of them. The same
search among the training rows themselves gives the evidence for thresholds (`matching.rejection`).

A run aligns consecutive queries with training rows at one speed. A row's cost for a query is the
sum of differences over the cheapest run in which the query passes that row (`AlignedQueries`):

1. Enhance the contrast of each difference against those of the rows around it.
2. Take the window of `length` + 1 queries around each query; near the ends of the drive, the
   first or the last window.
3. In each window find the cheapest run past each row, over all speeds (and both ways, if wanted).
4. Derive from the costs how new each query is.

The numerical kernels of these steps are in `matching.sequence`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, NotNegative, Positive, Range, checked
from pipeline.matching import holdout
from pipeline.matching.database import Database
from pipeline.matching.ranking import Ranking, Rows, joined
from pipeline.matching.rejection import NoveltyEvidence, is_near
from pipeline.matching.sequence import (
    GRAIN,
    cheapest,
    enhance_contrast,
    least_contrast,
    runner_up,
    runs,
    search,
)

QUERIES = 256
"""How many queries are searched at once: the costs of all rows for all queries may not fit into
memory."""
MAX_NOVELTY = float(np.finfo(np.float32).max)
"""Bound of a novelty, which is stored as float32."""
Costs = NDArray[np.float32]
"""Costs (query, row) of training rows for queries."""
NormalisationRows = Annotated[int, Range(2, wording="2 or more")]
Differences = Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]
"""A function of the method that compares training rows with each other: takes rows (n,), and rows
(m,) as queries, and returns their differences (n, m)."""


@dataclass(frozen=True)
@checked("method")
class SequenceMethod:
    """The settings of a method that matches all queries of a drive together.

    Each query is answered with the rows at which the best matching sequences pass it.
    """

    length: Count = 10
    """Steps of a run: it has `length` + 1 queries."""
    slowest: Positive = 0.8
    """Lowest speed tried, in training rows per query."""
    fastest: float = 1.2
    """Highest speed tried, in training rows per query."""
    speed_step: Annotated[float, Range(1 / GRAIN, wording=f"{1 / GRAIN} or more")] = 0.1
    """Step between the speeds tried, in training rows per query."""
    both_ways: bool = False
    """Whether runs may also pass the training sequence backwards; the authors' runs do not."""
    normalisation_rows: NormalisationRows = 30
    """Width of the window of training rows in which contrast is enhanced."""
    subtract_minimum: bool = True
    """Whether costs are counted from the least enhanced difference, so that none is negative, as in
    SeqSLAM. Paper 2's code leaves this out, and where its costs are negative its score is reversed.
    """
    novelty: Literal["cost", "ratio"] = "cost"
    """The cost of the best sequence, or SeqSLAM's ratio of it to the best cost elsewhere."""
    distinct_places: bool = False
    """Whether a ranking lists each place once, at its cheapest training row. Otherwise it lists
    training rows, and a place may occur several times."""
    validation_every_m: Positive = 200.0
    validation_length_m: Positive = 40.0
    """One block of this length in every `validation_every_m` of the training path is used for
    validation, to choose epochs and thresholds."""
    neighbour_m: NotNegative = 20.0
    """To simulate a novel place, a validation query is compared only with training rows at least
    this far away."""

    def __post_init__(self) -> None:
        if self.fastest < self.slowest:
            raise ConfigError(
                f"method.fastest={self.fastest}: expected at least slowest={self.slowest}"
            )

    @property
    def kinds(self) -> tuple[str, str]:
        """The two kinds of novelty, the chosen one first."""
        return ("cost", "ratio") if self.novelty == "cost" else ("ratio", "cost")

    def validation(self, views: Rows) -> NDArray[np.bool_]:
        """True for the training rows (n,) in validation blocks, which must not be learned."""
        places = np.zeros(len(views.world_T_anchor), np.int64)
        return holdout.blocks(
            views.world_T_anchor, places, self.validation_every_m, self.validation_length_m
        )

    def ranked(
        self,
        database: Database,
        differences: NDArray[np.float32],
        k: int,
        turned_deg: NDArray[np.floating] | None = None,
    ) -> Ranking:
        """Rank the m queries of a drive by their differences (n, m) from the database's n rows.

        `turned_deg` (n, m) is each query's yaw against each row. Near the ends of the drive a query
        is answered by the first or last whole sequence, at its own position in it. If there are
        fewer queries or rows than a sequence needs, a shorter sequence is used, its cost scaled up
        to the full length. If fewer than k rows are left, the rest are place −1 at an infinite
        cost.
        """
        if differences.shape[0] != len(database.places):
            raise InputError(
                f"differences of shape {differences.shape}: expected a row for each of "
                f"{len(database.places)}"
            )
        aligned = AlignedQueries(self, differences)
        parts = []
        for queries, sums in aligned.blocks():
            # Distinct places need the order of all rows.
            candidates = sums.shape[1] if self.distinct_places else k
            rows = cheapest(sums, candidates)
            costs = np.take_along_axis(sums, rows, axis=1) - aligned.base
            candidate_turn_deg = None
            if turned_deg is not None:
                candidate_turn_deg = turned_deg[rows, queries[:, None]]
            ranking = database.answer(costs, rows, k, self.distinct_places, candidate_turn_deg)
            by_kind = aligned.novelty(sums, rows[:, 0])
            novelty = np.stack([by_kind[kind] for kind in self.kinds], axis=1).astype(np.float32)
            parts.append(replace(ranking, novelty=novelty, kinds=self.kinds))
        return joined(parts)

    def evidence(self, database: Database, views: Rows, difference: Differences) -> NoveltyEvidence:
        """Match the odd training rows with the even ones; returns the results in validation blocks.

        All odd rows are matched as one drive, so that its sequences stay whole, and no query can
        match itself. Only rows in validation blocks count, or all rows if the path is too short for
        blocks. Each row counts twice: matched with all even rows, as a query from a seen place, and
        without the rows around it, as a query from a novel place.
        """
        n = len(database.places)
        even = np.arange(0, n, 2)
        odd = np.arange(min(1, n - 1), n, 2)
        is_counted = self.validation(views)[odd]
        if not is_counted.any():
            is_counted = np.ones(len(odd), bool)

        aligned = AlignedQueries(self, difference(even, odd))
        right = []
        seen = []
        unseen = []
        for queries, sums in aligned.blocks():
            rows = odd[queries][is_counted[queries]]
            sums = sums[is_counted[queries]]
            if not len(rows):
                continue
            best_row = sums.argmin(axis=1)
            right.append(database.places[even[best_row]] == database.places[rows])
            seen.append(aligned.novelty(sums, best_row))

            is_around = is_near(database.xy_m[rows], database.xy_m[even], self.neighbour_m)
            is_far = ~is_around & np.isfinite(sums)
            is_allowed = is_far | ~is_far.any(axis=1, keepdims=True)
            far_sums = np.where(is_allowed, sums, np.float32(np.inf))
            unseen.append(aligned.novelty(far_sums, far_sums.argmin(axis=1)))

        is_query = np.zeros(n, bool)
        is_query[odd[is_counted]] = True
        block = holdout.number_blocks(
            views.world_T_anchor, is_query, self.validation_every_m, self.validation_length_m
        )
        return NoveltyEvidence(
            np.concatenate(right), self._joined_kinds(seen), self._joined_kinds(unseen), block
        )

    def _joined_kinds(
        self, parts: list[dict[str, NDArray[np.float64]]]
    ) -> dict[str, NDArray[np.float64]]:
        """Each kind of novelty of all parts, one after the other."""
        return {kind: np.concatenate([part[kind] for part in parts]) for kind in self.kinds}


class AlignedQueries:
    """The m queries of a drive, aligned with all n training rows."""

    base: np.float32
    """The least cost that a run can have; it is subtracted from costs before they are ranked. 0
    unless `subtract_minimum`."""

    def __init__(self, settings: SequenceMethod, differences: NDArray[np.float32]) -> None:
        """Enhance the `differences` (n, m); raises InputError if they are not finite."""
        n, m = differences.shape
        self.settings = settings
        self.n_queries = m
        # Too few queries or rows get a shorter run, whose sums are scaled up to the full length.
        # At the lowest speed that is tried, but at least one row per query, a run of `max_steps`
        # still fits into the n rows.
        max_steps = int((n - 1) / max(settings.slowest, 1))
        self.length = max(min(settings.length, m - 1, max_steps), 0)
        self.scale = np.float32((settings.length + 1) / (self.length + 1))
        self.enhanced = enhance_contrast(differences, settings.normalisation_rows)
        lowest = float(self.enhanced.min(initial=0))
        if not math.isfinite(lowest):
            raise InputError("differences between queries and rows: expected finite numbers")
        if m <= settings.length:
            # The minimum over so few queries says little, so the lowest possible value is used.
            lowest = least_contrast(settings.normalisation_rows)
        self.base = np.float32(lowest * (settings.length + 1) if settings.subtract_minimum else 0)

    def blocks(self) -> Iterator[tuple[NDArray[np.int64], Costs]]:
        """Yield blocks of queries (q,), each with the costs (q, n) of all rows.

        A cost is +inf if no run passes the row.
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

        `cost` is the cost of the best row (q,), `ratio` is this cost over the lowest cost more than
        half a run away. For `cost` the least difference is not subtracted, since it differs from
        drive to drive, and a threshold must suit all drives.
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
