"""Answers with poses: rankings in which registered poses come first (METHODS 9.6).

How new each query looks is then judged by its fix.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ConfigError
from pipeline.core.frames import Poses, yaw
from pipeline.core.schemas import Fixes, Rankings
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.posing.fix import Fix
from pipeline.posing.verdict import BELIEFS, PROMISES, Judge

OWN_KINDS = BELIEFS
"""Kinds of novelty that a fix adds: one minus the chance of each belief in it."""
MISSING = {"places": -1, "costs": np.inf, "xy_m": np.nan, "heading_deg": np.nan}
"""The values of a missing answer, column by column."""
UNREGISTERED = 1.0
"""Cost from which the method's own answers follow those that were registered, whose cost is one
minus their chance."""


@dataclass(frozen=True)
class PosedQuery:
    """The poses that a query may have, the likeliest first, and what is believed of them."""

    world_T_query: Poses
    """(h, 4, 4)."""
    chances: NDArray[np.float64]
    """(h,) that each is right."""
    covariance: NDArray[np.float64]
    """(6, 6) of the first: a turn in radians and a step in metres, in the query's frame."""
    overlap: float
    """Share of the query that the map has where the first pose lays it."""
    doubts: NDArray[np.float64]
    """(belief,) in each of BELIEFS."""

    @classmethod
    def of(cls, fix: Fix, judge: Judge) -> Self:
        """What a judge makes of the fix of a 3-D scan."""
        poses = [hypothesis.world_T_query for hypothesis in fix.hypotheses]
        return cls(
            np.array(poses).reshape(-1, 4, 4),
            np.array(fix.chances),
            fix.alignment.covariance,
            fix.alignment.overlap,
            judge.doubts(fix),
        )

    @property
    def pose(self) -> Poses:
        """The likeliest pose (4, 4); NaN without one."""
        return self.world_T_query[0] if len(self.world_T_query) else np.full((4, 4), np.nan)


def posed(ranking: Ranking, queries: Sequence[PosedQuery], places: Places) -> Ranking:
    """The ranking with its fixes first: positions, headings, and places of the registered poses.

    A place is the cell that a pose lies in, −1 where training never went. One minus the doubt in
    the pose becomes the confidence. A place is answered once; what is then missing of k is place −1
    at an infinite cost.
    """
    k = ranking.places.shape[1]
    answers = {
        name: getattr(ranking, name).copy() for name in ("places", "costs", "xy_m", "heading_deg")
    }
    for i, query in enumerate(queries):
        if not len(query.world_T_query):
            continue
        xy_m = query.world_T_query[:, :2, 3]
        answers["costs"][i] = UNREGISTERED + np.arange(k) / k
        lead(
            answers,
            i,
            {
                "places": places.at(xy_m),
                "costs": 1 - query.chances,
                "xy_m": xy_m,
                "heading_deg": np.rad2deg(yaw(query.world_T_query)),
            },
        )
    doubts = np.array([query.doubts for query in queries]).reshape(-1, len(BELIEFS))
    novelty = np.column_stack([doubts, ranking.novelty]).astype(np.float32)
    confidence = (1 - doubts[:, 0]).astype(np.float32)
    return replace(
        ranking,
        **answers,
        novelty=novelty,
        kinds=(*OWN_KINDS, *ranking.kinds),
        confidence=confidence,
    )


def lead(answers: Mapping[str, NDArray[Any]], row: int, first: Mapping[str, Any]) -> None:
    """Put the answers `first`, likeliest first, before the k answers of a row, in place.

    A place is answered once, what is then missing is −1.
    """
    all_answers = {name: np.concatenate([first[name], answers[name][row]]) for name in MISSING}
    k = answers["places"].shape[1]
    kept = np.sort(np.unique(all_answers["places"], return_index=True)[1])[:k]
    for name, missing in MISSING.items():
        answers[name][row] = missing
        answers[name][row, : len(kept)] = all_answers[name][kept]


@dataclass(frozen=True)
class Posing:
    """Writes the rankings of one model again, with poses."""

    limits: Mapping[str, Sequence[float]]
    """For each of BELIEFS the doubt from which to reject it, one of PROMISES each."""
    blocks: int
    """Held-out blocks that the limits were checked on."""
    right_within: tuple[float, float]
    """Metres and degrees within which a pose is right."""
    places: Places
    wanted_precision: float

    def __post_init__(self) -> None:
        if self.wanted_precision not in PROMISES:
            raise ConfigError(
                f"wanted_precision={self.wanted_precision}: expected one of "
                f"{', '.join(map(str, PROMISES))}"
            )

    def write(self, path: Path, rankings: Rankings, queries: Sequence[PosedQuery]) -> str:
        """Write the poses of a ranking's queries (q,), in all its cases.

        Returns what was done, in a line.
        """
        answered = posed(rankings.ranking(), queries, self.places)
        promise_number = PROMISES.index(self.wanted_precision)
        thresholds = dict(zip(rankings.kinds, rankings.thresholds, strict=True))
        thresholds |= {belief: self.limits[belief][promise_number] for belief in BELIEFS}
        artifact = Fixes(
            **vars(answered),
            turned_deg=rankings.turned_deg,
            cases=rankings.cases,
            thresholds=tuple(thresholds[kind] for kind in answered.kinds),
            wanted_precision=self.wanted_precision,
            world_T_query=np.array([query.pose for query in queries]).reshape(-1, 4, 4),
            covariance=np.array([query.covariance for query in queries]).reshape(-1, 6, 6),
            overlap=np.array([query.overlap for query in queries], np.float32),
            promises=PROMISES,
            promised=tuple(self.limits["fix"]),
            promised_place=tuple(self.limits["place"]),
            promised_several=tuple(self.limits["several"]),
            held_out=self.blocks,
            right_within=self.right_within,
        )
        store.write(path, artifact)
        return f"{path.stem}: {self._summary(answered, queries, promise_number)}"

    def _summary(
        self,
        answered: Ranking,
        queries: Sequence[PosedQuery],
        promise_number: int,
    ) -> str:
        """How many queries have a pose, and for how many each belief is promised, in a line."""
        pose_count = sum(len(query.world_T_query) > 0 for query in queries)
        number = next((i for i in range(promise_number, -1, -1) if self.limits["fix"][i] > 0), None)
        if number is None:
            return f"{pose_count} poses of {len(queries)} queries; no promise can be kept"
        below = answered.novelty[:, : len(BELIEFS)].astype(float) < [
            self.limits[belief][number] for belief in BELIEFS
        ]
        most_telling = np.where(below.any(axis=1), below.argmax(axis=1), -1)
        pose, place, several = (int((most_telling == i).sum()) for i in range(len(BELIEFS)))
        beliefs = f"{pose} are accepted, {place} more are near, {several} more are one of several"
        return (
            f"{pose_count} poses of {len(queries)} queries; with a promise of {PROMISES[number]} "
            f"{beliefs}"
        )
