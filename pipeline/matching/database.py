"""The database of a method that trains nothing: training submaps in; rankings of queries out.

It has the place and pose of each training submap. Beside it a method keeps their descriptors, and a
query's answer is the place of the nearest one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import wrapped_deg, yaw
from pipeline.core.progress import Progress
from pipeline.core.settings import NotNegative, Positive, check
from pipeline.matching import holdout
from pipeline.matching.nearest import first_of_each, nearest
from pipeline.matching.ranking import Model, Ranking, Rows, TrainingSet, joined
from pipeline.matching.rejection import Evidence, is_near

PREFIX = "database/"
"""Of the arrays' names in a model."""
QUERIES = 256
"""Queries compared with the whole database at once."""
KIND = "distance"
"""The one kind of novelty: how far the nearest descriptor is (RA-L 2019, Sec. V-A; METHODS 2.7)."""
Search = Callable[
    [NDArray[np.int64], NDArray[np.bool_]], tuple[NDArray[np.float64], NDArray[np.int64]]
]
"""Takes some training rows (h,) as queries, and which rows (h, n) each may be compared with.

Gives the distance (h,) and the row (h,) of the nearest of those.
"""


class UntrainedMethod(ABC):
    """A method that trains nothing: with further days its database is made from all rows."""

    @abstractmethod
    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """The database of all rows."""

    def grow(
        self, model: Model, learned_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """The model of all rows, as if they had been learned at once."""
        return self.learn(*TrainingSet.joined([learned_set, new_set]), progress)


@dataclass(frozen=True)
class DescriptorMethod(UntrainedMethod):
    """Settings of every method that answers with the nearest of a database."""

    distinct_places: bool = False
    """Whether a ranking is of places, each once where its nearest training row lies, and not of
    training rows."""
    held_out_every_m: Positive = 40.0
    held_out_length_m: Positive = 4.0
    """One block of this length in every `held_out_every_m` of the training path is held out to
    choose thresholds."""
    neighbour_m: NotNegative = 20.0
    """A held-out query counts as unseen once the training rows nearer than this are forgotten."""

    def __post_init__(self) -> None:
        check(self, "method")


@dataclass(frozen=True)
class Database:
    """Place and pose of each training submap."""

    places: NDArray[np.int64]
    """(n,)"""
    xy_m: NDArray[np.float64]
    """(n, 2) in the world."""
    yaw_deg: NDArray[np.float64]
    """(n,) in the world."""

    @classmethod
    def learned(cls, views: Rows, places: NDArray[np.int64]) -> Self:
        """The database of the training sequence; raises InputError unless each view has a place."""
        if len(places) != len(views.world_T_anchor) or not len(places) or (places < 0).any():
            raise InputError("every view of the training sequence needs a known place")
        return cls(
            places.astype(np.int64),
            views.world_T_anchor[:, :2, 3],
            np.rad2deg(yaw(views.world_T_anchor)),
        )

    @classmethod
    def of(cls, model: Model) -> Self:
        """The database in a model."""
        return cls(
            **{name.removeprefix(PREFIX): model[name] for name in model if name.startswith(PREFIX)}
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its arrays, as they are stored in a model."""
        return {PREFIX + name: array for name, array in asdict(self).items()}

    def evidence(self, search: Search, views: Rows, method: DescriptorMethod) -> Evidence:
        """What held-out blocks of the path are answered by the rest of it.

        Once with the blocks' surroundings, as queries that were seen, and once without, as unseen
        ones. The model's database holds the blocks too: only a threshold is chosen on them.
        """
        is_held_out = holdout.blocks(
            views.world_T_anchor, self.places, method.held_out_every_m, method.held_out_length_m
        )
        if not is_held_out.any():  # a path too short for blocks: each view against the others
            is_held_out = ~is_held_out
        queries = np.flatnonzero(is_held_out)
        allowed = (
            queries[:, None] != np.arange(len(is_held_out))
            if is_held_out.all()
            else np.broadcast_to(~is_held_out, (len(queries), len(is_held_out)))
        )
        allowed_and_far = allowed & ~is_near(self.xy_m[queries], self.xy_m, method.neighbour_m)
        seen_distance, nearest_rows = search(queries, allowed)
        has_far = allowed_and_far.any(axis=1, keepdims=True)
        unseen_distance, _ = search(queries, np.where(has_far, allowed_and_far, allowed))
        block = holdout.numbered(
            views.world_T_anchor, is_held_out, method.held_out_every_m, method.held_out_length_m
        )
        right = self.places[nearest_rows] == self.places[queries]
        return Evidence(right, {KIND: seen_distance}, {KIND: unseen_distance}, block)

    def answer(
        self,
        distances: NDArray[np.float32],
        rows: NDArray[np.int64],
        k: int,
        distinct_places: bool,
        turned_deg: NDArray[np.floating] | None = None,
    ) -> Ranking:
        """The ranking of q queries, each with m candidates: training rows (q, m), nearest first.

        `distances` (q, m) rise. `turned_deg` (q, m) is the query's yaw against each candidate's.
        With `distinct_places` a place is answered once, where its nearest training row lies; else
        neighbouring rows of one place follow each other. What is missing of k places, or at no
        finite distance, is place −1 at an infinite cost.
        """
        columns = (
            first_of_each(self.places[rows], k)
            if distinct_places
            else np.arange(min(k, rows.shape[1]))
        )
        columns = np.broadcast_to(columns, (len(rows), columns.shape[-1]))
        costs = np.take_along_axis(distances, columns.clip(0), axis=1)
        ranked_rows = np.take_along_axis(rows, columns.clip(0), axis=1)
        exists = (columns >= 0) & np.isfinite(costs)
        ranked_turn_deg = (
            np.nan
            if turned_deg is None
            else np.take_along_axis(turned_deg, columns.clip(0), axis=1)
        )
        query_yaw_deg = wrapped_deg(self.yaw_deg[ranked_rows] + ranked_turn_deg)
        heading_deg = np.where(exists, query_yaw_deg, np.nan)
        return Ranking(
            np.where(exists, self.places[ranked_rows], -1),
            np.where(exists, costs, np.inf).astype(np.float32),
            np.where(exists[..., None], self.xy_m[ranked_rows], np.nan),
            distances[:, :1].astype(np.float32),
            np.full(len(rows), np.nan, np.float32),
            heading_deg.astype(np.float32),
            (KIND,),
        )

    def nearest(
        self,
        descriptors: NDArray[np.float32],
        queries: NDArray[np.float32],
        k: int,
        distinct_places: bool,
    ) -> Ranking:
        """Rank queries (q, d) by Euclidean distance to the database's descriptors (n, d)."""
        if not distinct_places:
            return self.answer(*nearest(descriptors, queries, k), k, distinct_places=False)
        parts = (queries[i : i + QUERIES] for i in range(0, max(len(queries), 1), QUERIES))
        return joined(
            [
                self.answer(*nearest(descriptors, part, len(descriptors)), k, distinct_places=True)
                for part in parts
            ]
        )


def euclidean(descriptors: NDArray[np.float32]) -> Search:
    """The search among training's own descriptors (n, d)."""

    def search(
        queries: NDArray[np.int64], allowed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        distances = np.where(
            allowed, scipy.spatial.distance.cdist(descriptors[queries], descriptors), np.inf
        )
        rows = distances.argmin(axis=1)
        return distances[np.arange(len(queries)), rows], rows

    return search
