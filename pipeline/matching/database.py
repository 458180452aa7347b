"""The database of a method that trains nothing: training submaps in, rankings of queries out.

It holds the place and the pose of each training submap; a row is one submap. A method keeps the
descriptors of the same rows beside it, searches them for the rows nearest to a query, and the
database turns these rows into a ranking of places. It also collects the evidence from which a
threshold for unseen queries is chosen (`matching.rejection`).
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
from pipeline.core.settings import NotNegative, Positive, checked
from pipeline.matching import holdout
from pipeline.matching.nearest import first_of_each, nearest
from pipeline.matching.ranking import Model, Ranking, Rows, TrainingSet, joined
from pipeline.matching.rejection import NoveltyEvidence, is_near

PREFIX = "database/"
"""Prefix of the database's arrays in a model."""
QUERIES = 256
"""Queries compared with the whole database at once, so that the distances fit into memory."""
KIND = "distance"
"""The only kind of novelty: the distance to the nearest descriptor (RA-L 2019, Sec. V-A; METHODS
2.7)."""
Search = Callable[
    [NDArray[np.int64], NDArray[np.bool_]], tuple[NDArray[np.float64], NDArray[np.int64]]
]
"""A function that finds, for some training rows, the nearest other training rows.

It takes the rows (h,) to search for, and a mask (h, n) of the rows that each may be compared with.
It returns the distance (h,) to the nearest of these, and the nearest row (h,).
"""


class UntrainedMethod(ABC):
    """A method that trains nothing: with further days it learns all rows again."""

    @abstractmethod
    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Make the model of all rows, whose `places` (row,) are known."""

    def extend(
        self, model: Model, learned_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Make the model of both sets, as if they had been learned together."""
        return self.learn(*TrainingSet.joined([learned_set, new_set]), progress)


@dataclass(frozen=True)
@checked("method")
class DescriptorMethod(UntrainedMethod):
    """The settings of every method that answers with the nearest descriptors of a database."""

    distinct_places: bool = False
    """Whether a ranking lists each place once, at its nearest training row. Otherwise it lists
    training rows, and a place may occur several times."""
    validation_every_m: Positive = 40.0
    validation_length_m: Positive = 4.0
    """One block of this length in every `validation_every_m` of the training path is used for
    validation, to choose thresholds."""
    neighbour_m: NotNegative = 20.0
    """To simulate a novel place, a validation query is compared only with training rows at least
    this far away."""


@dataclass(frozen=True)
class Database:
    """Place and pose of each training submap."""

    places: NDArray[np.int64]
    """(n,) the place of each row."""
    xy_m: NDArray[np.float64]
    """(n, 2) positions in the world."""
    yaw_deg: NDArray[np.float64]
    """(n,) headings in the world."""

    @classmethod
    def learned(cls, views: Rows, places: NDArray[np.int64]) -> Self:
        """Make the database of training; raises InputError unless each view has a place."""
        if len(places) != len(views.world_T_anchor) or not len(places) or (places < 0).any():
            raise InputError("every view of the training sequence needs a known place")
        return cls(
            places.astype(np.int64),
            views.world_T_anchor[:, :2, 3],
            np.rad2deg(yaw(views.world_T_anchor)),
        )

    @classmethod
    def of(cls, model: Model) -> Self:
        """Read the database that a model holds."""
        names = [name for name in model if name.startswith(PREFIX)]
        return cls(**{name.removeprefix(PREFIX): model[name] for name in names})

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The database's arrays, as they are stored in a model."""
        return {PREFIX + name: array for name, array in asdict(self).items()}

    def evidence(
        self, search: Search, views: Rows, method: DescriptorMethod, kind: str = KIND
    ) -> NoveltyEvidence:
        """Search for the rows of validation blocks among the rest of the training path.

        Each row is searched for twice: with the rows around it, as a query from a seen place, and
        without them, as a query from a novel place. The model's database keeps the blocks
        nevertheless, since they only serve to choose a threshold.
        """
        every_m = method.validation_every_m
        length_m = method.validation_length_m
        is_validation = holdout.blocks(views.world_T_anchor, self.places, every_m, length_m)
        if not is_validation.any():
            # The path is too short for blocks: every row is compared with all others.
            is_validation = ~is_validation
        queries = np.flatnonzero(is_validation)
        if is_validation.all():
            is_allowed = queries[:, None] != np.arange(len(is_validation))
        else:
            is_allowed = np.broadcast_to(~is_validation, (len(queries), len(is_validation)))
        seen_distances, nearest_rows = search(queries, is_allowed)

        is_around = is_near(self.xy_m[queries], self.xy_m, method.neighbour_m)
        is_allowed_and_far = is_allowed & ~is_around
        has_far = is_allowed_and_far.any(axis=1, keepdims=True)
        unseen_distances, _ = search(queries, np.where(has_far, is_allowed_and_far, is_allowed))

        return NoveltyEvidence(
            right=self.places[nearest_rows] == self.places[queries],
            seen={kind: seen_distances},
            unseen={kind: unseen_distances},
            block=holdout.number_blocks(views.world_T_anchor, is_validation, every_m, length_m),
        )

    def answer(
        self,
        distances: NDArray[np.float32],
        rows: NDArray[np.int64],
        k: int,
        distinct_places: bool,
        turned_deg: NDArray[np.floating] | None = None,
    ) -> Ranking:
        """Make the ranking of q queries from their candidates: rows (q, m), nearest first.

        `distances` (q, m) are the distances to the candidates, and `turned_deg` (q, m) is the
        query's yaw against each candidate. With `distinct_places`, a place is listed once, at its
        nearest row. If a query has fewer than k candidates at a finite distance, the rest are place
        −1 at an infinite cost.
        """
        if distinct_places:
            columns = first_of_each(self.places[rows], k)
        else:
            first_k = np.arange(min(k, rows.shape[1]))
            columns = np.broadcast_to(first_k, (len(rows), len(first_k)))
        exists = columns >= 0
        columns = columns.clip(0)
        costs = np.take_along_axis(distances, columns, axis=1)
        exists &= np.isfinite(costs)
        ranked_rows = np.take_along_axis(rows, columns, axis=1)
        ranked_turn_deg: NDArray[np.floating] | float = np.nan
        if turned_deg is not None:
            ranked_turn_deg = np.take_along_axis(turned_deg, columns, axis=1)
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
        # Distinct places need the order of all rows, for a block of queries at a time.
        parts = []
        for start in range(0, max(len(queries), 1), QUERIES):
            block = queries[start : start + QUERIES]
            distances, rows = nearest(descriptors, block, len(descriptors))
            parts.append(self.answer(distances, rows, k, distinct_places=True))
        return joined(parts)


def euclidean(descriptors: NDArray[np.float32]) -> Search:
    """Make the `Search` by Euclidean distance among training's own descriptors (n, d)."""

    def search(
        queries: NDArray[np.int64], is_allowed: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        distances = np.where(
            is_allowed, scipy.spatial.distance.cdist(descriptors[queries], descriptors), np.inf
        )
        rows = distances.argmin(axis=1)
        return distances[np.arange(len(queries)), rows], rows

    return search
