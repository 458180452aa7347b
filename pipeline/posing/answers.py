"""Answers with poses: rankings in which the registered poses come first (METHODS 9.6).

In: a method's ranking of places for each query, and the poses that registration found for it. Out:
a ranking of the same form, and the artifact `Fixes`. In this ranking the registered poses are the
first answers, and a query's novelty is the error probability of its pose. So the evaluation of
rankings evaluates poses as well.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import Poses, yaw
from pipeline.core.schemas import Fixes, Rankings
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.verdict import CLAIMS, AnyFix, Judge, Verdict

OWN_KINDS = CLAIMS
"""The kinds of novelty that poses add: the error probability of each claim, such as "the pose is
right"."""
MISSING_ANSWER = {"places": -1, "costs": np.inf, "xy_m": np.nan, "heading_deg": np.nan}
"""The values of a missing answer, column by column."""
UNREGISTERED_COST = 1.0
"""The least cost of the method's own answers. A registered pose costs less: one minus its
probability."""


@dataclass(frozen=True)
class PosedQuery:
    """The poses that a query may have, the likeliest first, and the error probability of each
    claim about them."""

    world_T_query: Poses
    """(h, 4, 4) poses."""
    probabilities: NDArray[np.float64]
    """(h,) the probability that each pose is right."""
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the first pose, by its registration: of a small turn in radians, then
    of a step in metres, in the query's frame."""
    overlap: float
    """Share of the query's points that lie on the map if the query stands at the first pose."""
    error_probabilities: NDArray[np.float64]
    """(claim,) one minus the probability of each claim, in the order of CLAIMS."""

    @classmethod
    def of(cls, fix: AnyFix, judge: Judge) -> Self:
        """The poses of a fix, with the error probabilities by a judge."""
        probabilities = np.array(fix.probabilities)
        return cls(
            fix.poses, probabilities, fix.covariance, fix.overlap, judge.error_probabilities(fix)
        )

    @property
    def pose(self) -> Poses:
        """The likeliest pose (4, 4); NaN without one."""
        return self.world_T_query[0] if len(self.world_T_query) else np.full((4, 4), np.nan)


def posed(ranking: Ranking, queries: Sequence[PosedQuery], places: Places) -> Ranking:
    """The ranking with the registered poses first, as positions, headings and places.

    The place of a pose is its grid cell, −1 where training never went. The confidence becomes the
    probability that the pose is right. Each place is answered once; if fewer than k answers are
    left, the last ones are MISSING_ANSWER.
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
            "costs": 1 - query.probabilities,
            "xy_m": xy_m,
            "heading_deg": np.rad2deg(yaw(query.world_T_query)),
        }
        put_first(answers, i, registered)
    error_probabilities = np.array([query.error_probabilities for query in queries]).reshape(
        -1, len(CLAIMS)
    )
    novelty = np.column_stack([error_probabilities, ranking.novelty]).astype(np.float32)
    confidence = (1 - error_probabilities[:, 0]).astype(np.float32)
    return replace(
        ranking,
        **answers,
        novelty=novelty,
        kinds=(*OWN_KINDS, *ranking.kinds),
        confidence=confidence,
    )


def put_first(answers: Mapping[str, NDArray[Any]], row: int, first: Mapping[str, Any]) -> None:
    """Put the answers `first`, the likeliest first, before the k answers of a row, in place.

    A place that is named twice keeps its first position only. If fewer than k answers are left,
    the last ones are MISSING_ANSWER.
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
    """Adds poses to the rankings of one model, and writes them as the artifact `Fixes`."""

    verdict: Verdict
    right_within: tuple[float, float]
    """Metres and degrees within which a pose is right."""
    places: Places
    """The grid cells that training visited."""
    target_precision: float
    """The wanted precision of the accepted poses; the largest below it that the verdict can keep
    is used if it cannot be kept."""

    def __post_init__(self) -> None:
        try:
            self.verdict.kept_precision(self.target_precision)
        except InputError as error:
            raise ConfigError(str(error)) from None

    def write(self, path: Path, rankings: Rankings, queries: Sequence[PosedQuery]) -> str:
        """Write the ranking with the poses of its queries (q,), in all its cases, to a path.

        Returns a one-line summary.
        """
        answered = posed(rankings.ranking(), queries, self.places)
        thresholds = dict(zip(rankings.kinds, rankings.thresholds, strict=True))
        claim_thresholds = self.verdict.claim_thresholds
        kept = self.verdict.kept_precision(self.target_precision)
        thresholds |= dict(zip(CLAIMS, self._claim_thresholds(kept), strict=True))
        covariances = np.array([query.covariance for query in queries]).reshape(-1, 6, 6)
        artifact = Fixes(
            **vars(answered),
            turned_deg=rankings.turned_deg,
            cases=rankings.cases,
            thresholds=tuple(thresholds[kind] for kind in answered.kinds),
            target_precision=self.target_precision if kept is None else kept,
            world_T_query=np.array([query.pose for query in queries]).reshape(-1, 4, 4),
            covariance=self.verdict.calibrated(covariances),
            overlap=np.array([query.overlap for query in queries], np.float32),
            target_precisions=self.verdict.target_precisions,
            pose_thresholds=claim_thresholds["fix"],
            place_thresholds=claim_thresholds["place"],
            several_thresholds=claim_thresholds["several"],
            validation_blocks=self.verdict.validation_blocks,
            right_within=self.right_within,
        )
        store.write(path, artifact)
        return f"{path.stem}: {self._summary(answered, queries, kept)}"

    def _claim_thresholds(self, kept: float | None) -> tuple[float, ...]:
        """The thresholds (claim,) of CLAIMS at the kept precision; None accepts nothing."""
        return (ACCEPT_NOTHING,) * len(CLAIMS) if kept is None else self.verdict.thresholds[kept]

    def _summary(
        self,
        answered: Ranking,
        queries: Sequence[PosedQuery],
        kept: float | None,
    ) -> str:
        """A line on how many queries have a pose, and for how many each claim is accepted.

        Claims are accepted at the `kept` precision, None if there is none.
        """
        pose_count = sum(len(query.world_T_query) > 0 for query in queries)
        if kept is None:
            return (
                f"{pose_count} poses of {len(queries)} queries; no target precision can be reached"
            )
        claim_thresholds = self._claim_thresholds(kept)
        is_accepted = (
            answered.novelty[:, : len(CLAIMS)].astype(float) < claim_thresholds
        )  # (q, claim)
        # Each query counts for its strongest accepted claim alone; −1 has none.
        strongest = np.where(is_accepted.any(axis=1), is_accepted.argmax(axis=1), -1)
        accepted, near, ambiguous = (int((strongest == i).sum()) for i in range(len(CLAIMS)))
        return (
            f"{pose_count} poses of {len(queries)} queries; at a target precision of "
            f"{kept} {accepted} are accepted, {near} more are near, "
            f"{ambiguous} more are one of several"
        )
