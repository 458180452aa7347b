"""What is true of each query: by the SCI paper's grid cells, and by distance.

Every number names which of the two it speaks of.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Positive, check

PROTOCOLS = ("cells", "distance")


@dataclass(frozen=True)
class Truth:
    """Which of q queries are seen, unseen and answered right under one protocol.

    A query neither seen nor unseen is not judged.
    """

    seen: NDArray[np.bool_]  # (q,) training went there
    unseen: NDArray[np.bool_]  # (q,) training never went there
    true_rank: NDArray[
        np.int64
    ]  # (q,) 0-based rank of the first right answer; −1 if not seen or not ranked
    oracle_right: NDArray[
        np.bool_
    ]  # (q,) seen, and answering the nearest training anchor would be right
    # recall is of all seen queries; else, as the SCI paper counts, of the hits and misses alone
    usual_recall: bool = False


def by_cells(
    places: NDArray[np.int64], true_places: NDArray[np.int64], oracle: NDArray[np.int64]
) -> Truth:
    """The SCI paper's protocol: right is the query's cell, and seen a query whose cell training
    visited.

    `places` (q, k) are the answers, cheapest first; `true_places` (q,) is −1 where training never
    went; `oracle` (q,) is the place of the nearest training anchor.
    """
    seen = true_places >= 0
    right = (places == true_places[:, None]) & seen[:, None]
    return Truth(seen, ~seen, _first(right), seen & (oracle == true_places))


@dataclass(frozen=True)
class Distance:
    """The protocol by distance (conf/tolerance), which no border of a grid cell cuts."""

    seen_m: Positive = 5.0  # seen: a training anchor is nearer than this
    correct_m: Positive = 15.0  # right: the answer lies at most this far from the query
    unseen_m: Positive = (
        15.0  # unseen: every training anchor is farther than this; a query between is not judged
    )

    def __post_init__(self) -> None:
        check(self, "distance")
        if self.seen_m > self.unseen_m:
            raise ConfigError(
                f"distance.seen_m={self.seen_m}: expected at most distance.unseen_m={self.unseen_m}"
            )

    def truth(
        self,
        answers_xy_m: NDArray[np.float64],
        xy_m: NDArray[np.float64],
        nearest_m: NDArray[np.float64],
    ) -> Truth:
        """The truth of queries at `xy_m` (q, 2) answered with positions (q, k, 2).

        `nearest_m` (q,) is how far they are from training.
        """
        seen = nearest_m < self.seen_m
        away_m = np.linalg.norm(answers_xy_m - xy_m[:, None], axis=2)
        right = (away_m <= self.correct_m) & seen[:, None]
        return Truth(
            seen,
            nearest_m > self.unseen_m,
            _first(right),
            seen & (nearest_m <= self.correct_m),
            usual_recall=True,
        )


def _first(right: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Rank (q,) of the first right answer of (q, k); −1 where none is."""
    return np.where(right.any(axis=1), right.argmax(axis=1), -1)
