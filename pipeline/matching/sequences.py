"""Base of the methods that match sequences of queries with sequences of training rows: PFL, AFL,
SAD.

A method gives the differences between a drive's queries and the training rows; SeqSLAM's search
(METHODS 6) with paper 2's settings and scores (METHODS 5.5) makes a ranking of them. The same
search among training's own rows gives the evidence for thresholds (`matching.rejection`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.settings import NotNegative, Positive
from pipeline.matching import holdout
from pipeline.matching.alignment import AlignedQueries, Alignment
from pipeline.matching.database import Database
from pipeline.matching.ranking import Ranking, Rows, joined
from pipeline.matching.rejection import Evidence, is_near
from pipeline.matching.sequence import cheapest

Differences = Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]
"""A function of the method that compares training with itself: takes training rows (n,) and others
(m,) as queries, and returns their differences (n, m)."""


@dataclass(frozen=True)
class SequenceMethod(Alignment):
    """The settings of a method that matches all queries of a drive together.

    Each query is answered with the rows at which the best matching sequences pass it.
    """

    novelty: Literal["cost", "ratio"] = "cost"
    """The cost of the best sequence, or SeqSLAM's ratio of it to the best cost elsewhere."""
    distinct_places: bool = False
    """Whether a ranking lists each place once, at its cheapest training row. Otherwise it lists
    training rows, and a place may come several times."""
    held_out_every_m: Positive = 200.0
    held_out_length_m: Positive = 40.0
    """One block of this length in every `held_out_every_m` of the training path is held out to
    choose epochs and thresholds."""
    neighbour_m: NotNegative = 20.0
    """To stand for an unseen query, a held-out one is compared only with training rows at least
    this far away."""

    def __post_init__(self) -> None:
        super().__post_init__()

    @property
    def kinds(self) -> tuple[str, str]:
        """The two kinds of novelty, the chosen one first."""
        return ("cost", "ratio") if self.novelty == "cost" else ("ratio", "cost")

    def held_out(self, views: Rows) -> NDArray[np.bool_]:
        """True for the training rows (n,) that are held out and must not be learned."""
        places = np.zeros(len(views.world_T_anchor), np.int64)
        return holdout.blocks(
            views.world_T_anchor, places, self.held_out_every_m, self.held_out_length_m
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
        is answered by the first or last whole sequence, at its own position in it. Where there are
        fewer queries or rows than a sequence needs, a shorter one answers, its cost scaled up to
        the full length. Where fewer than k rows are left, the rest are place −1 at an infinite
        cost."""
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

    def evidence(self, database: Database, views: Rows, difference: Differences) -> Evidence:
        """Match the odd training rows with the even ones; returns the results in held-out blocks.

        All odd rows are matched as one drive, so that its sequences stay whole, and no query can
        match itself; only those in held-out blocks count, or all on a path too short for blocks.
        Each counts twice: with all even rows, as a query from a seen place, and without those
        around it, as one from an unseen place.
        """
        n = len(database.places)
        even = np.arange(0, n, 2)
        odd = np.arange(min(1, n - 1), n, 2)
        is_counted = self.held_out(views)[odd]
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
        block = holdout.numbered(
            views.world_T_anchor, is_query, self.held_out_every_m, self.held_out_length_m
        )
        return Evidence(
            np.concatenate(right), self._joined_kinds(seen), self._joined_kinds(unseen), block
        )

    def _joined_kinds(
        self, parts: list[dict[str, NDArray[np.float64]]]
    ) -> dict[str, NDArray[np.float64]]:
        """Each kind of novelty of all parts, one after the other."""
        return {kind: np.concatenate([part[kind] for part in parts]) for kind in self.kinds}
