"""The lazy quadruplet loss, and the choice of clouds that it compares (Uy and Lee, CVPR 2018;
METHODS 3.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.errors import InputError

CANDIDATES = 4000
"""Random negatives among which the hardest are looked for."""


def lazy_quadruplet(
    tuples: Tensor, positives: int, margin: float, margin_star: float
) -> tuple[Tensor, Tensor]:
    """Loss and number of right tuples, of descriptors in the order of `Tuples`.

    Descriptors are (tuple, 1 + positives + negatives + 1, size). Distances are squared. Of a
    query's positives only the nearest counts, of its negatives only the worst: they are to be
    further than it by a margin from the query, and by another from a cloud n* that is near none of
    them. A tuple is right where its nearest positive is nearer than every negative.
    """
    query = tuples[:, :1]
    positive = tuples[:, 1 : 1 + positives]
    negative = tuples[:, 1 + positives : -1]
    star = tuples[:, -1:]
    to_positive = (query - positive).square().sum(2).amin(1)
    to_negative = (query - negative).square().sum(2).amin(1)
    star_to_negative = (star - negative).square().sum(2).amin(1)
    loss = (margin + to_positive - to_negative).relu() + (
        margin_star + to_positive - star_to_negative
    ).relu()
    return loss.mean(), (to_positive < to_negative).sum()


@dataclass(frozen=True)
class Tuples:
    """Draws query, positives, negatives and n* among training rows by where they lie.

    In a world so small that a row's furthest lies within 2 `negative_m`, what is beyond half of
    that distance is negative.
    """

    xy_m: NDArray[np.float64]
    """(n, 2)."""
    positive_m: float
    negative_m: float
    positives: int
    negatives: int
    hard: int
    """How many of the negatives are the hardest, once there are descriptors to tell."""

    def queries(self) -> NDArray[np.int64]:
        """The rows that have a positive and a negative; raises InputError where none has."""
        rows = [
            row for row in range(len(self.xy_m)) if all(len(part) for part in self._around(row))
        ]
        if not rows:
            raise InputError(
                f"no training view has another within {self.positive_m:g} m and one further away"
            )
        return np.array(rows)

    def draw(
        self, query: int, rng: np.random.Generator, descriptors: NDArray[np.float32] | None = None
    ) -> NDArray[np.int64]:
        """Rows (1 + positives + negatives + 1,): the query, its positives, its negatives, n*.

        Some twice where there are few. n* is a random row further than `positive_m` from the query
        and its negatives, or where there is none the one furthest from them.
        """
        positive_rows, negative_rows = self._around(query)
        negative_rows = rng.permutation(negative_rows)
        if descriptors is not None:
            candidates = negative_rows[:CANDIDATES]
            hardest = candidates[
                np.argsort(-descriptors[candidates] @ descriptors[query], kind="stable")[
                    : self.hard
                ]
            ]
            negative_rows = np.concatenate(
                [hardest, negative_rows[~np.isin(negative_rows, hardest)]]
            )
        positive_rows = np.resize(rng.permutation(positive_rows), self.positives)
        negative_rows = np.resize(negative_rows, self.negatives)
        query_and_negatives = np.unique(np.append(negative_rows, query))
        gap_m = np.linalg.norm(self.xy_m[:, None] - self.xy_m[query_and_negatives], axis=2).min(
            axis=1
        )
        free = np.flatnonzero(gap_m > self.positive_m)
        return np.concatenate(
            [
                [query],
                positive_rows,
                negative_rows,
                [rng.choice(free) if len(free) else gap_m.argmax()],
            ]
        )

    def _around(self, query: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """A row's positives, without itself, and negatives."""
        distance_m = np.linalg.norm(self.xy_m - self.xy_m[query], axis=1)
        far_m = min(self.negative_m, distance_m.max() / 2)
        is_positive = distance_m <= min(self.positive_m, far_m)
        is_positive[query] = False
        return np.flatnonzero(is_positive), np.flatnonzero(distance_m > far_m)
