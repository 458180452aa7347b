"""The lazy quadruplet loss, and the choice of clouds that it compares (Uy and Lee, CVPR 2018;
METHODS 3.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pipeline.errors import InputError

CANDIDATES = 4000  # random negatives among which the hardest are looked for


def lazy_quadruplet(
    tuples: Tensor, positives: int, margin: float, margin_star: float
) -> tuple[Tensor, Tensor]:
    """Loss and number of right tuples, of descriptors (tuple, 1 + positives + negatives + 1, size)
    in the order of `Tuples`.

    Distances are squared. Of a query's positives only the nearest counts, of its negatives only the
    worst: they are to be further than it by a margin from the query, and by another from a cloud n*
    that is near none of them. A tuple is right where its nearest positive is nearer than every
    negative.
    """
    query = tuples[:, :1]
    near = tuples[:, 1 : 1 + positives]
    far = tuples[:, 1 + positives : -1]
    star = tuples[:, -1:]
    best = (query - near).square().sum(2).amin(1)
    apart = (query - far).square().sum(2).amin(1)
    apart_star = (star - far).square().sum(2).amin(1)
    loss = (margin + best - apart).relu() + (margin_star + best - apart_star).relu()
    return loss.mean(), (best < apart).sum()


@dataclass(frozen=True)
class Tuples:
    """Draws query, positives, negatives and n* among training rows by where they lie.

    In a world so small that a row's furthest lies within 2 `negative_m`, what is beyond half of
    that distance is negative.
    """

    xy_m: NDArray[np.float64]  # (n, 2)
    positive_m: float
    negative_m: float
    positives: int
    negatives: int
    hard: int  # how many of the negatives are the hardest, once there are descriptors to tell

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
        """Rows (1 + positives + negatives + 1,): the query, its positives, its negatives, n*; some
        twice where there are few.

        n* is a random row further than `positive_m` from the query and its negatives, or where
        there is none the one furthest from them.
        """
        near, far = self._around(query)
        far = rng.permutation(far)
        if descriptors is not None:
            candidates = far[:CANDIDATES]
            hardest = candidates[
                np.argsort(-descriptors[candidates] @ descriptors[query], kind="stable")[
                    : self.hard
                ]
            ]
            far = np.concatenate([hardest, far[~np.isin(far, hardest)]])
        near = np.resize(rng.permutation(near), self.positives)
        far = np.resize(far, self.negatives)
        taken = np.unique(np.append(far, query))
        gap_m = np.linalg.norm(self.xy_m[:, None] - self.xy_m[taken], axis=2).min(axis=1)
        free = np.flatnonzero(gap_m > self.positive_m)
        return np.concatenate(
            [[query], near, far, [rng.choice(free) if len(free) else gap_m.argmax()]]
        )

    def _around(self, query: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """A row's positives, without itself, and negatives."""
        distance_m = np.linalg.norm(self.xy_m - self.xy_m[query], axis=1)
        far_m = min(self.negative_m, distance_m.max() / 2)
        near = distance_m <= min(self.positive_m, far_m)
        near[query] = False
        return np.flatnonzero(near), np.flatnonzero(distance_m > far_m)
