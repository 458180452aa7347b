"""Answers with poses: rankings in which the registered poses come first (METHODS 9.6).

In: a method's ranking of places for each query, and the poses that registration found for it. Out:
a ranking of the same form, and the artifact `Fixes`. In it the registered poses are the first
answers, and how new a query looks is the doubt in its pose. So everything that judges rankings
judges poses.
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
from pipeline.posing.verdict import BELIEFS, PROMISES, AnyFix, Judge, Verdict

OWN_KINDS = BELIEFS
"""The kinds of novelty that poses add: the doubt in each belief, such as that the pose is right."""
MISSING_ANSWER = {"places": -1, "costs": np.inf, "xy_m": np.nan, "heading_deg": np.nan}
"""The values of a missing answer, column by column."""
UNREGISTERED_COST = 1.0
"""The least cost of the method's own answers. Registered poses cost less: one minus their
chance."""


@dataclass(frozen=True)
class PosedQuery:
    """The poses that a query may have, the likeliest first, and the doubts in them."""

    world_T_query: Poses
    """(h, 4, 4) poses."""
    chances: NDArray[np.float64]
    """(h,) the chance that each pose is right."""
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the first pose: of a turn in radians and a step in metres, in the
    query's frame."""
    overlap: float
    """Share of the query's points that the map has too, if the query stands at the first pose."""
    doubts: NDArray[np.float64]
    """(belief,) one minus the chance of each of BELIEFS."""

    @classmethod
    def of(cls, fix: AnyFix, judge: Judge) -> Self:
        """The poses of a fix, with the doubts of a judge."""
        chances = np.array(fix.chances)
        return cls(fix.poses, chances, fix.covariance, fix.overlap, judge.doubts(fix))

    @property
    def pose(self) -> Poses:
        """The likeliest pose (4, 4); NaN without one."""
        return self.world_T_query[0] if len(self.world_T_query) else np.full((4, 4), np.nan)


def posed(ranking: Ranking, queries: Sequence[PosedQuery], places: Places) -> Ranking:
    """The ranking with the registered poses first, as positions, headings and places.

    The place of a pose is the cell that it lies in, −1 where training never went. The confidence
    becomes the chance that the pose is right. Each place is answered once; if fewer than k answers
    are left, the last ones are MISSING_ANSWER.
    """
    k = ranking.places.shape[1]
    answers = {
        name: getattr(ranking, name).copy() for name in ("places", "costs", "xy_m", "heading_deg")
    }
    for i, query in enumerate(queries):
        if not len(query.world_T_query):
            continue
        xy_m = query.world_T_query[:, :2, 3]
        # The method's own answers keep their order, behind the registered poses.
        answers["costs"][i] = UNREGISTERED_COST + np.arange(k) / k
        registered = {
            "places": places.at(xy_m),
            "costs": 1 - query.chances,
            "xy_m": xy_m,
            "heading_deg": np.rad2deg(yaw(query.world_T_query)),
        }
        lead(answers, i, registered)
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

    Each place stays in once, where it comes first. If fewer than k answers are left, the last ones
    are MISSING_ANSWER.
    """
    all_answers = {
        name: np.concatenate([first[name], answers[name][row]]) for name in MISSING_ANSWER
    }
    k = answers["places"].shape[1]
    _, first_of_each_place = np.unique(all_answers["places"], return_index=True)
    chosen = np.sort(first_of_each_place)[:k]
    for name, missing in MISSING_ANSWER.items():
        answers[name][row] = missing
        answers[name][row, : len(chosen)] = all_answers[name][chosen]


@dataclass(frozen=True)
class Posing:
    """Writes the rankings of one model again, with poses."""

    verdict: Verdict
    right_within: tuple[float, float]
    """Metres and degrees within which a pose is right."""
    places: Places
    """The grid cells that training visited."""
    wanted_precision: float
    """The promise that is kept where poses are accepted: one of PROMISES."""

    def __post_init__(self) -> None:
        if self.wanted_precision not in PROMISES:
            raise ConfigError(
                f"wanted_precision={self.wanted_precision}: expected one of "
                f"{', '.join(map(str, PROMISES))}"
            )

    def write(self, path: Path, rankings: Rankings, queries: Sequence[PosedQuery]) -> str:
        """Write the ranking with the poses of its queries (q,), in all its cases, to a path.

        Returns a summary of one line.
        """
        answered = posed(rankings.ranking(), queries, self.places)
        promise_number = PROMISES.index(self.wanted_precision)
        thresholds = dict(zip(rankings.kinds, rankings.thresholds, strict=True))
        limits = self.verdict.promised
        thresholds |= {belief: limits[belief][promise_number] for belief in BELIEFS}
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
            promised=limits["fix"],
            promised_place=limits["place"],
            promised_several=limits["several"],
            held_out=self.verdict.held_out,
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
        """How many queries have a pose, and for how many each belief is accepted, in a line.

        Beliefs are accepted at the wanted promise, or at the highest one below that can be kept.
        """
        pose_count = sum(len(query.world_T_query) > 0 for query in queries)
        kept_promises = [
            i for i in range(promise_number + 1) if self.verdict.promised["fix"][i] > 0
        ]
        if not kept_promises:
            return f"{pose_count} poses of {len(queries)} queries; no promise can be kept"
        number = kept_promises[-1]
        limits = [self.verdict.promised[belief][number] for belief in BELIEFS]
        is_accepted = answered.novelty[:, : len(BELIEFS)].astype(float) < limits  # (q, belief)
        # Each query counts for its strongest accepted belief alone; −1 has none.
        strongest = np.where(is_accepted.any(axis=1), is_accepted.argmax(axis=1), -1)
        accepted, near, ambiguous = (int((strongest == i).sum()) for i in range(len(BELIEFS)))
        beliefs = (
            f"{accepted} are accepted, {near} more are near, {ambiguous} more are one of several"
        )
        return (
            f"{pose_count} poses of {len(queries)} queries; with a promise of {PROMISES[number]} "
            f"{beliefs}"
        )
