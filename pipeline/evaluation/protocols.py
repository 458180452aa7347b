"""Protocols: which queries count as seen, and which answers as right.

In: where queries were taken, what a method answered, where training went. Out: a `GroundTruth`,
from which `counts` and `numbers` are computed. There are two protocols, and every number names its
own: "cells", by grid cells as in the SCI paper (Kim, Park and Kim, RA-L 2019), and "distance", by
metres between answer and query.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Positive, checked

PROTOCOLS = ("cells", "distance")


@dataclass(frozen=True)
class GroundTruth:
    """Which of q queries are seen, unseen and answered right under one protocol.

    A query neither seen nor unseen is not judged.
    """

    seen: NDArray[np.bool_]
    """(q,) whether training went there."""
    unseen: NDArray[np.bool_]
    """(q,) whether training never went there."""
    true_rank: NDArray[np.int64]
    """(q,) 0-based rank of the first right answer; −1 if not seen or not ranked."""
    oracle_right: NDArray[np.bool_]
    """(q,) whether it is seen, and answering the nearest training anchor would be right."""
    recall_of_all_seen: bool = False
    """Whether recall is the share of all seen queries, as usual.

    If not, it is true positives / (true positives + false negatives) as in the SCI paper, which
    leaves out the seen queries that are accepted with a wrong answer.
    """


def by_cells(
    places: NDArray[np.int64], true_places: NDArray[np.int64], oracle: NDArray[np.int64]
) -> GroundTruth:
    """The ground truth by the SCI paper's protocol.

    A query is seen if training visited its grid cell, and an answer is right if it is that cell.
    `places` (q, k) are the answers, cheapest first; `true_places` (q,) is −1 where training never
    went; `oracle` (q,) is the place of the nearest training anchor.
    """
    seen = true_places >= 0
    right = (places == true_places[:, None]) & seen[:, None]
    return GroundTruth(seen, ~seen, _first_right_rank(right), seen & (oracle == true_places))


@dataclass(frozen=True)
@checked("distance")
class Distance:
    """The protocol by distance, without borders of grid cells: the keys of conf/tolerance."""

    seen_m: Positive = 5.0
    """A query is seen if a training anchor is nearer than this."""
    correct_m: Positive = 15.0
    """An answer is right if it lies at most this far from the query."""
    unseen_m: Positive = 15.0
    """A query is unseen if every training anchor is farther than this."""

    def __post_init__(self) -> None:
        if self.seen_m > self.unseen_m:
            raise ConfigError(
                f"distance.seen_m={self.seen_m}: expected at most distance.unseen_m={self.unseen_m}"
            )

    def ground_truth(
        self,
        answers_xy_m: NDArray[np.float64],
        xy_m: NDArray[np.float64],
        nearest_m: NDArray[np.float64],
    ) -> GroundTruth:
        """The ground truth of queries at `xy_m` (q, 2) answered with positions (q, k, 2).

        `nearest_m` (q,) is their distance to the nearest training anchor.
        """
        seen = nearest_m < self.seen_m
        answer_error_m = np.linalg.norm(answers_xy_m - xy_m[:, None], axis=2)
        right = (answer_error_m <= self.correct_m) & seen[:, None]
        return GroundTruth(
            seen,
            nearest_m > self.unseen_m,
            _first_right_rank(right),
            seen & (nearest_m <= self.correct_m),
            recall_of_all_seen=True,
        )


def _first_right_rank(right: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The rank (q,) of the first right answer, given which answers (q, k) are; −1 if none is."""
    return np.where(right.any(axis=1), right.argmax(axis=1), -1)
