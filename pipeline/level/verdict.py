"""Verdicts on level fixes: the chance that each belief is right, and the doubt to reject it from.

The chances are those of 3-D fixes with other signs (posing/chances.py); what is believed of them is
too: the pose, that the robot is near it, or that it has one of several.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import distance_and_turn
from pipeline.level.fix import SCALES, LevelFix, signs
from pipeline.matching.rejection import ACCEPT_NOTHING, threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.verdict import BELIEFS, PROMISES, SEVERAL, middle

RIGHT_M = 1.0
RIGHT_DEG = 10.0
"""A level fix is right within RIGHT_M and RIGHT_DEG."""
RIGHT_WITHIN = (RIGHT_M, RIGHT_DEG)
NEAR_M = 5.0
"""A robot is near its pose within this."""
TIMES = 5.0
"""No single belief is accepted whose doubt is over so many times what a promise allows in the mean
(METHODS 13)."""


@dataclass(frozen=True)
class LevelJudge:
    """Gives the chance of each belief in a level fix."""

    pose: Chances
    near: Chances

    def chances(self, fix: LevelFix) -> NDArray[np.float64]:
        """The chance (n,) that each hypothesis is right."""
        return self.pose.of(signs(fix))

    def doubts(self, fix: LevelFix) -> NDArray[np.float64]:
        """One minus the chance (belief,) of each of BELIEFS; 1 without a hypothesis."""
        if not fix.hypotheses:
            return np.ones(len(BELIEFS))
        fix_signs = signs(fix)
        pose_shares = self.pose.shares(fix_signs)
        near_shares = self.near.shares(fix_signs)
        far = np.append(_distances_m(fix) >= NEAR_M, True)
        return np.array(
            [pose_shares[1:].sum(), near_shares[far].sum(), pose_shares[SEVERAL:].sum()]
        ).clip(0, 1)


USUAL = LevelJudge(
    Chances((9.01, 0.0, 8.64, 6.94, 23.67), -17.57),
    Chances((8.93, 0.0, 8.63, 6.96, 23.39), -17.52),
)
"""Learned from held-out stretches of the first halves of three recorded buildings (`python -m
benchmarks.level CARMEN --usual`)."""
USUAL_LIMITS: dict[str, tuple[float, ...]] = {
    "fix": (0.25, 0.05, ACCEPT_NOTHING),
    "place": (0.25, 0.05, ACCEPT_NOTHING),
    "several": (0.25, ACCEPT_NOTHING, ACCEPT_NOTHING),
}
"""For each of BELIEFS the doubts from which to reject it, by the same stretches; one of PROMISES
each."""
LARGEST_DOUBT = max(limit for limits in USUAL_LIMITS.values() for limit in limits)
"""From this doubt on nothing is believed in any map."""


@dataclass(frozen=True)
class LevelEvidence:
    """Fixes of held-out queries, each asked once with and once without its surroundings."""

    fixes: Sequence[LevelFix]
    world_T_true: NDArray[np.float64]
    """(fix, 4, 4)."""
    unseen: NDArray[np.bool_]
    """(fix,) asked without its surroundings in the map."""
    block: NDArray[np.int64]
    """(fix,) the stretch of path that it is of: neighbours are no independent evidence."""

    @classmethod
    def joined(cls, parts: Sequence["LevelEvidence"]) -> "LevelEvidence":
        """The evidence of several maps."""
        firsts = np.cumsum([0, *(part.block.max(initial=-1) + 1 for part in parts)])
        return cls(
            [fix for part in parts for fix in part.fixes],
            np.concatenate([np.empty((0, 4, 4)), *(part.world_T_true for part in parts)]),
            np.concatenate([np.empty(0, bool), *(part.unseen for part in parts)]),
            np.concatenate(
                [
                    np.empty(0, np.int64),
                    *(part.block + first for part, first in zip(parts, firsts, strict=False)),
                ]
            ),
        )

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return len(np.unique(self.block))

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """For how many of `blocks` independent queries each fix (fix,) counts."""
        share = np.where(self.unseen, unseen_share, 1 - unseen_share)
        alike = np.where(self.unseen, max(self.unseen.sum(), 1), max((~self.unseen).sum(), 1))
        return np.asarray(self.blocks * share / alike)


@dataclass(frozen=True)
class LevelVerdict:
    """Judges the fixes of a map: by the usual chances, and limits that its own evidence keeps."""

    evidence: LevelEvidence
    unseen_share: float
    """Share of queries to expect from places that the map does not have."""
    judge: LevelJudge = USUAL

    def learned(self) -> LevelJudge:
        """A judge learned from the evidence, starting from this one."""
        outcomes = [
            right(fix, true)
            for fix, true in zip(self.evidence.fixes, self.evidence.world_T_true, strict=True)
        ]
        all_signs = [signs(fix) for fix in self.evidence.fixes]
        weight = self.evidence.weight(self.unseen_share)
        return LevelJudge(
            learned(all_signs, [good for good, _ in outcomes], weight, self.judge.pose, SCALES),
            learned(all_signs, [near for _, near in outcomes], weight, self.judge.near, SCALES),
        )

    def reached(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which to reject one of BELIEFS, by evidence alone.

        As posing/verdict.py: one more of the accepted counts as wrong, the limit stands in the
        middle of the gap to the next that would break the promise, and nothing is accepted that is
        false more than TIMES as often as the promise allows.
        """
        doubts, truths = self._judged(belief)
        weight = self.evidence.weight(self.unseen_share)
        edges = [threshold_for(promise, doubts, truths, weight, 1.0) for promise in PROMISES]
        return [
            min(middle(doubts, edge), TIMES * (1 - promise))
            for promise, edge in zip(PROMISES, edges, strict=True)
        ]

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which to reject one of BELIEFS in this map.

        It is the usual limit, or a lower one where that breaks the promise on the map's own
        evidence: one building has too few blocks to promise anything by itself.
        """
        doubts, truths = self._judged(belief)
        weight = self.evidence.weight(self.unseen_share)
        limits = []
        for promise, usual in zip(PROMISES, USUAL_LIMITS[belief], strict=True):
            below = doubts < usual
            wrong = float(weight[below & ~truths].sum())
            is_kept = wrong <= (1 - promise) * float(weight[below].sum())
            kept = threshold_for(promise, doubts[below], truths[below], weight[below])
            limits.append(usual if is_kept else kept)
        return limits

    def _judged(self, belief: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubts (fix,) of one belief in the evidence, and whether it is true."""
        doubts = np.ones((len(self.evidence.fixes), len(BELIEFS)))
        truths = np.zeros(doubts.shape, bool)
        for row, (fix, true) in enumerate(
            zip(self.evidence.fixes, self.evidence.world_T_true, strict=True)
        ):
            ordered = fix.ordered(self.judge.pose)
            doubts[row] = self.judge.doubts(ordered).astype(np.float32)
            if fix.hypotheses:
                good, near = right(ordered, true)
                truths[row] = good[0], near[0], good[:SEVERAL].any()
        number = BELIEFS.index(belief)
        return doubts[:, number], truths[:, number]


def right(
    fix: LevelFix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are near."""
    poses = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]).reshape(-1, 4, 4)
    away_m = np.linalg.norm(poses[:, :2, 3] - world_T_true[:2, 3], axis=1)
    return pose_is_right(poses, np.broadcast_to(world_T_true, poses.shape)), away_m < NEAR_M


def pose_is_right(
    world_T_query: NDArray[np.float64], world_T_true: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which poses (n, 4, 4) are right in the plane; a missing one is not."""
    away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:, :2, 3], axis=1)
    return np.asarray(
        (away_m < RIGHT_M) & (distance_and_turn(world_T_query, world_T_true)[1] < RIGHT_DEG)
    )


def _distances_m(fix: LevelFix) -> NDArray[np.float64]:
    """The distances (n,) of all hypotheses from the best one."""
    places_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))
