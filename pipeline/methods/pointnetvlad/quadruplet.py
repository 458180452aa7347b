"""The lazy quadruplet loss of PointNetVLAD, and the choice of the clouds that it compares.

`Tuples` draws for a query some positives (clouds of the same place), negatives (clouds far away)
and one cloud n* that is far from all of these. `lazy_quadruplet` is the loss of their descriptors.
Both are by Uy and Lee, CVPR 2018 (METHODS 3.2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.errors import InputError

CANDIDATES = 4000
"""The number of random negatives among which the hardest are searched."""


def lazy_quadruplet(
    tuples: Tensor, positives: int, margin: float, margin_star: float
) -> tuple[Tensor, Tensor]:
    """The mean loss of some tuples, and the number of right tuples.

    `tuples` (tuple, 1 + positives + negatives + 1, size) are descriptors in the order of
    `Tuples.draw`; `positives` is the number of positives in a tuple. With squared distances, and d
    the query's distance to its nearest positive, the loss of a tuple is max(0, margin + d −
    distance from the query to the nearest negative) + max(0, margin_star + d − distance from n* to
    the nearest negative). A tuple is right if its nearest positive is nearer than every negative.
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
    """Draws positives, negatives and n* for a query by the positions of the training clouds.

    A row is a training cloud. In small worlds `negative_m` is capped at half the largest distance
    from the query; `positive_m` never exceeds it.
    """

    xy_m: NDArray[np.float64]
    """(n, 2) positions, a row for each training cloud."""
    positive_m: float
    """Rows at most this far from the query are positives."""
    negative_m: float
    """Rows farther than this from the query are negatives."""
    positives: int
    """The number of positives of a query."""
    negatives: int
    """The number of negatives of a query."""
    hard: int
    """How many of the negatives are hard ones, with the descriptors most similar to the query's;
    all negatives are random as long as there are no descriptors."""

    def queries(self) -> NDArray[np.int64]:
        """Rows (q,) that have a positive and a negative; raises InputError if there are none."""
        rows = []
        for row in range(len(self.xy_m)):
            positive_rows, negative_rows = self._around(row)
            if len(positive_rows) and len(negative_rows):
                rows.append(row)
        if not rows:
            raise InputError(
                f"no training view has another within {self.positive_m:g} m and one further away"
            )
        return np.array(rows)

    def draw(
        self, query: int, rng: np.random.Generator, descriptors: NDArray[np.float32] | None = None
    ) -> NDArray[np.int64]:
        """Draw rows (1 + positives + negatives + 1,): the query, positives, negatives, n*.

        `descriptors` (n, size) are those of all training clouds. Rows are repeated if there are too
        few. n* is a random row farther than `positive_m` from
        the query and its negatives; if there is no such row, it is the row farthest from them.
        """
        positive_rows, negative_rows = self._around(query)
        # Random negatives; with descriptors, the most similar (hardest) ones come first.
        negative_rows = rng.permutation(negative_rows)
        if descriptors is not None:
            candidates = negative_rows[:CANDIDATES]
            most_similar = np.argsort(-descriptors[candidates] @ descriptors[query], kind="stable")
            hardest = candidates[most_similar[: self.hard]]
            random_rows = negative_rows[~np.isin(negative_rows, hardest)]
            negative_rows = np.concatenate([hardest, random_rows])
        positive_rows = np.resize(rng.permutation(positive_rows), self.positives)
        negative_rows = np.resize(negative_rows, self.negatives)
        # n* by the distance of each row to the nearest among the query and its negatives.
        query_and_negatives = np.unique(np.append(negative_rows, query))
        distances_m = np.linalg.norm(self.xy_m[:, None] - self.xy_m[query_and_negatives], axis=2)
        gap_m = distances_m.min(axis=1)
        far_rows = np.flatnonzero(gap_m > self.positive_m)
        star = rng.choice(far_rows) if len(far_rows) else gap_m.argmax()
        return np.concatenate([[query], positive_rows, negative_rows, [star]])

    def _around(self, query: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The rows of a query's positives, without the query, and of its negatives."""
        distance_m = np.linalg.norm(self.xy_m - self.xy_m[query], axis=1)
        far_m = min(self.negative_m, distance_m.max() / 2)
        is_positive = distance_m <= min(self.positive_m, far_m)
        is_positive[query] = False
        return np.flatnonzero(is_positive), np.flatnonzero(distance_m > far_m)
