"""Answers with poses: rankings in which registered poses come first (METHODS 9.6).

How new each query looks is then judged by its fix.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ConfigError
from pipeline.core.frames import yaw
from pipeline.core.schemas import Fixes, Rankings
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.posing.fix import Fix, poses
from pipeline.posing.verdict import BELIEFS, PROMISES, Verdict

OWN_KINDS = BELIEFS
"""Kinds of novelty that a fix adds: one minus the chance of each belief in it."""
MISSING = {"places": -1, "costs": np.inf, "xy_m": np.nan, "heading_deg": np.nan}
"""The values of a missing answer, column by column."""
UNREGISTERED = 1.0
"""Cost from which the method's own answers follow those that were registered, whose cost is one
minus their chance."""


def posed(
    ranking: Ranking, fixes: Sequence[Fix], places: Places, doubts: NDArray[np.float64]
) -> Ranking:
    """The ranking with its fixes first: positions, headings, and places of the registered poses.

    A place is the cell that a pose lies in, −1 where training never went. One minus the first of
    the doubts (q, belief), that in the pose, becomes the confidence. A place is answered once; what
    is then missing of k is place −1 at an infinite cost.
    """
    k = ranking.places.shape[1]
    answers = {
        name: getattr(ranking, name).copy() for name in ("places", "costs", "xy_m", "heading_deg")
    }
    for i, fix in enumerate(fixes):
        if not fix.hypotheses:
            continue
        world_T_query = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses])
        xy_m = world_T_query[:, :2, 3]
        costs = 1 - np.array(fix.chances)
        answers["costs"][i] = UNREGISTERED + np.arange(k) / k
        lead(
            answers,
            i,
            {
                "places": places.at(xy_m),
                "costs": costs,
                "xy_m": xy_m,
                "heading_deg": np.rad2deg(yaw(world_T_query)),
            },
        )
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

    verdict: Verdict
    places: Places
    wanted_precision: float

    def __post_init__(self) -> None:
        if self.wanted_precision not in PROMISES:
            raise ConfigError(
                f"wanted_precision={self.wanted_precision}: expected one of "
                f"{', '.join(map(str, PROMISES))}"
            )

    def write(self, path: Path, rankings: Rankings, fixes: Sequence[Fix]) -> str:
        """Write the fixes (q,) of a ranking's queries, in all its cases.

        Returns what was done, in a line.
        """
        answered = posed(rankings.ranking(), fixes, self.places, self.verdict.judge.of(fixes))
        limits = {belief: self.verdict.limits(belief) for belief in BELIEFS}
        promise_number = PROMISES.index(self.wanted_precision)
        thresholds = dict(zip(rankings.kinds, rankings.thresholds, strict=True))
        thresholds |= {belief: limits[belief][promise_number] for belief in BELIEFS}
        covariances = [fix.alignment.covariance for fix in fixes]
        artifact = Fixes(
            **vars(answered),
            turned_deg=rankings.turned_deg,
            cases=rankings.cases,
            thresholds=tuple(thresholds[kind] for kind in answered.kinds),
            wanted_precision=self.wanted_precision,
            world_T_query=poses(fixes),
            covariance=np.array(covariances).reshape(-1, 6, 6),
            overlap=np.array([fix.alignment.overlap for fix in fixes], np.float32),
            promises=PROMISES,
            promised=tuple(limits["fix"]),
            promised_place=tuple(limits["place"]),
            promised_several=tuple(limits["several"]),
            held_out=self.verdict.evidence.blocks,
        )
        store.write(path, artifact)
        return f"{path.stem}: {self._summary(answered, limits, fixes, promise_number)}"

    def _summary(
        self,
        answered: Ranking,
        limits: Mapping[str, Sequence[float]],
        fixes: Sequence[Fix],
        promise_number: int,
    ) -> str:
        """How many queries have a pose, and for how many each belief is promised, in a line."""
        pose_count = sum(bool(fix.hypotheses) for fix in fixes)
        number = next((i for i in range(promise_number, -1, -1) if limits["fix"][i] > 0), None)
        if number is None:
            return f"{pose_count} poses of {len(fixes)} queries; no promise can be kept"
        below = answered.novelty[:, : len(BELIEFS)].astype(float) < [
            limits[belief][number] for belief in BELIEFS
        ]
        most_telling = np.where(below.any(axis=1), below.argmax(axis=1), -1)
        pose, place, several = (int((most_telling == i).sum()) for i in range(len(BELIEFS)))
        beliefs = f"{pose} are accepted, {place} more are near, {several} more are one of several"
        return (
            f"{pose_count} poses of {len(fixes)} queries; with a promise of {PROMISES[number]} "
            f"{beliefs}"
        )
