"""Verdicts on level fixes: the chance that each belief is right, and the doubt to reject it from.

The chances are those of 3-D fixes with other signs (posing/chances.py); what is believed of them is
too: the pose, that the robot is near it, or that it has one of several.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import apart
from pipeline.level.fix import SCALES, LevelFix, signs
from pipeline.matching.rejection import threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.verdict import BELIEFS, PROMISES, SEVERAL, TIMES, middle

RIGHT_M = 1.0
RIGHT_DEG = 10.0
"""A level fix is right within RIGHT_M and RIGHT_DEG."""
NEAR_M = 5.0
"""A robot is near its pose within this."""


@dataclass(frozen=True)
class LevelJudge:
    """Gives the chance of each belief in a level fix."""

    pose: Chances
    near: Chances

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
    Chances((6.0, 6.0, 1.0, 20.0), -4.0),
    Chances((6.0, 6.0, 1.0, 20.0), -4.0),
)
"""What a map is judged by that has no evidence of its own."""


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
    """Learns from evidence how to judge level fixes."""

    evidence: LevelEvidence
    unseen_share: float
    """Share of queries to expect from places that the map does not have."""
    start: LevelJudge = USUAL

    @cached_property
    def judge(self) -> LevelJudge:
        """The judge, learned from the evidence."""
        outcomes = [
            right(fix, true)
            for fix, true in zip(self.evidence.fixes, self.evidence.world_T_true, strict=True)
        ]
        all_signs = [signs(fix) for fix in self.evidence.fixes]
        weight = self.evidence.weight(self.unseen_share)
        return LevelJudge(
            learned(all_signs, [good for good, _ in outcomes], weight, self.start.pose, SCALES),
            learned(all_signs, [near for _, near in outcomes], weight, self.start.near, SCALES),
        )

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which to reject one of BELIEFS.

        As posing/verdict.py: one more of the accepted counts as wrong, the limit stands in the
        middle of the gap to the next that would break the promise, and nothing is accepted that is
        false more than TIMES as often as the promise allows.
        """
        number = BELIEFS.index(belief)
        doubts, truths = self._judged
        weight = self.evidence.weight(self.unseen_share)
        limits = []
        for promise in PROMISES:
            edge = threshold_for(
                promise, doubts[:, number], truths[:, number], weight, wrong_besides=1.0
            )
            limits.append(min(middle(doubts[:, number], edge), TIMES * (1 - promise)))
        return limits

    @cached_property
    def _judged(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubts of the evidence (fix, belief), and which beliefs are true."""
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
        return doubts, truths


def right(
    fix: LevelFix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are near."""
    poses = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]).reshape(-1, 4, 4)
    true = np.broadcast_to(world_T_true, poses.shape)
    away_m = np.linalg.norm(poses[:, :2, 3] - true[:, :2, 3], axis=1)
    turn_deg = apart(poses, true)[1]
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG), away_m < NEAR_M


def _distances_m(fix: LevelFix) -> NDArray[np.float64]:
    """The distances (n,) of all hypotheses from the best one."""
    places_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))
