"""Methods that match a sequence of queries with a sequence of training rows: PFL, AFL and SAD.

SeqSLAM's contrast enhancement and search (METHODS 6) with paper 2's settings and scores (METHODS
5.5).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.settings import NotNegative, Positive
from pipeline.matching import holdout
from pipeline.matching.alignment import Aligned, Alignment
from pipeline.matching.database import Database
from pipeline.matching.ranking import Ranking, Rows, joined
from pipeline.matching.rejection import Evidence, is_near
from pipeline.matching.sequence import cheapest

Differences = Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]
"""Differences (n, m) of training rows (m,) as queries from other training rows (n,)."""


@dataclass(frozen=True)
class SequenceMethod(Alignment):
    """A method that matches a drive's queries together with sequences of training rows.

    It answers with the rows of the best matching sequence.
    """

    novelty: Literal["cost", "ratio"] = (
        "cost"  # the sequence's cost, or SeqSLAM's ratio of it to the best cost elsewhere
    )
    distinct_places: bool = False
    """Rank places, each once where its cheapest training row lies, instead of training rows."""
    held_out_every_m: Positive = 200.0
    held_out_length_m: Positive = 40.0
    """One block of this length in every `held_out_every_m` of the training path is held out to
    choose epochs and thresholds."""
    neighbour_m: NotNegative = 20.0
    """A held-out query counts as unseen once the training rows nearer than this are forgotten."""

    def __post_init__(self) -> None:
        super().__post_init__()

    @property
    def kinds(self) -> tuple[str, str]:
        """The kinds of novelty, the chosen one first."""
        return ("cost", "ratio") if self.novelty == "cost" else ("ratio", "cost")

    def held_out(self, views: Rows) -> NDArray[np.bool_]:
        """The training rows (n,) that learning must not see."""
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

        `turned_deg` (n, m) is each query's yaw against each row. A query less than half a sequence
        from either end is answered by the nearest whole one, at its own position in it; where there
        are fewer queries or rows than a sequence has, a shorter one answers, its cost brought to
        the whole length. What is missing of k rows is place −1 at an infinite cost.
        """
        if differences.shape[0] != len(database.places):
            raise InputError(
                f"differences of shape {differences.shape}: expected a row for each of "
                f"{len(database.places)}"
            )
        aligned = Aligned(self, differences)
        parts = []
        for queries, sums in aligned.blocks():
            rows = cheapest(sums, sums.shape[1] if self.distinct_places else k)
            costs = np.take_along_axis(sums, rows, axis=1) - aligned.base
            turned = None if turned_deg is None else turned_deg[rows, queries[:, None]]
            kinds = aligned.novelty(sums, rows[:, 0])
            novelty = np.stack([kinds[kind] for kind in self.kinds], axis=1).astype(np.float32)
            ranking = database.answer(costs, rows, k, self.distinct_places, turned)
            parts.append(replace(ranking, novelty=novelty, kinds=self.kinds))
        return joined(parts)

    def evidence(self, database: Database, views: Rows, difference: Differences) -> Evidence:
        """Results of the odd training rows of held-out blocks against the even rows.

        Once with and once without the queries' surroundings. All odd rows are matched as one
        sequence, which stays whole, and no query can match itself. On a path too short for blocks
        all of them count.
        """
        n = len(database.places)
        even = np.arange(0, n, 2)
        odd = np.arange(min(1, n - 1), n, 2)
        counts = self.held_out(views)[odd]
        counts = counts if counts.any() else np.ones(len(odd), bool)
        aligned = Aligned(self, difference(even, odd))
        is_query = np.zeros(n, bool)
        right = []
        seen = []
        unseen = []
        is_query[odd[counts]] = True
        for queries, sums in aligned.blocks():
            rows = odd[queries][counts[queries]]
            sums = sums[counts[queries]]
            if not len(rows):
                continue
            best_row = sums.argmin(axis=1)
            right.append(database.places[even[best_row]] == database.places[rows])
            seen.append(aligned.novelty(sums, best_row))
            is_far = ~is_near(
                database.xy_m[rows], database.xy_m[even], self.neighbour_m
            ) & np.isfinite(sums)
            sums = np.where(is_far | ~is_far.any(axis=1, keepdims=True), sums, np.float32(np.inf))
            unseen.append(aligned.novelty(sums, sums.argmin(axis=1)))
        seen_kinds, unseen_kinds = (
            {kind: np.concatenate([part[kind] for part in parts]) for kind in self.kinds}
            for parts in (seen, unseen)
        )
        block = holdout.numbered(
            views.world_T_anchor, is_query, self.held_out_every_m, self.held_out_length_m
        )
        return Evidence(np.concatenate(right), seen_kinds, unseen_kinds, block)
