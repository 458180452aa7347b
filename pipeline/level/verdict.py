"""Verdicts on level fixes: whether to believe them (METHODS 13.4).

Three things may be believed of a fix, its BELIEFS (posing/verdict.py): that the best pose is right,
that the robot is near it, and that one of the first few poses is right. The doubt in a belief is
one minus its chance. Here a `LevelJudge` gives the doubts in a fix, and a `LevelVerdict` the limit
from which on to reject each: one for each promised precision (PROMISES), tested on held-out queries
of the map.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import LEVEL_RIGHT_WITHIN, distance_and_turn
from pipeline.level.fix import SCALES, LevelFix, signs
from pipeline.matching.rejection import ACCEPT_NOTHING, threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.verdict import BELIEFS, PROMISES, SEVERAL, middle

RIGHT_M, RIGHT_DEG = LEVEL_RIGHT_WITHIN
NEAR_M = 5.0
"""A robot is near a pose within this."""
LARGEST_MULTIPLE = 5.0
"""No belief is accepted whose doubt is over so many times the share of wrong ones that the promise
allows (METHODS 13.4)."""


@dataclass(frozen=True)
class LevelJudge:
    """Gives the doubts in a level fix, by the signs of its hypotheses (fix.py)."""

    pose: Chances
    """Gives the chance that a hypothesis is right."""
    near: Chances
    """Gives the chance that a hypothesis is near."""

    def chances(self, fix: LevelFix) -> NDArray[np.float64]:
        """The chance (n,) that each hypothesis is right."""
        return self.pose.of(signs(fix))

    def doubts(self, fix: LevelFix) -> NDArray[np.float64]:
        """The doubt (belief,) in each of BELIEFS; 1 without a hypothesis.

        It is the sum of the shares of all that would make the belief false. The last share is that
        of none of the hypotheses.
        """
        if not fix.hypotheses:
            return np.ones(len(BELIEFS))
        fix_signs = signs(fix)
        pose_shares = self.pose.shares(fix_signs)
        near_shares = self.near.shares(fix_signs)
        far = np.append(_distances_m(fix) >= NEAR_M, True)
        not_best = pose_shares[1:].sum()
        not_near = near_shares[far].sum()
        # the last share is none of the hypotheses, however few there are
        not_one_of_several = pose_shares[min(SEVERAL, len(fix.hypotheses)) :].sum()
        return np.array([not_best, not_near, not_one_of_several]).clip(0, 1)


USUAL = LevelJudge(
    Chances((9.01, 0.0, 8.64, 6.94, 23.67), -17.57),
    Chances((8.93, 0.0, 8.63, 6.96, 23.39), -17.52),
)
"""The judge of any map: learned from held-out stretches of the first halves of three recorded
buildings (`python -m benchmarks.level CARMEN --usual`)."""
USUAL_LIMITS: dict[str, tuple[float, ...]] = {
    "fix": (0.25, 0.05, ACCEPT_NOTHING),
    "place": (0.25, 0.05, ACCEPT_NOTHING),
    "several": (0.25, ACCEPT_NOTHING, ACCEPT_NOTHING),
}
"""For each of BELIEFS the doubts from which on to reject it, one for each of PROMISES, by the same
stretches."""
LARGEST_DOUBT = max(max(limits) for limits in USUAL_LIMITS.values())
"""No belief with this doubt or a larger one is accepted in any map."""


@dataclass(frozen=True)
class LevelEvidence:
    """Fixes of held-out queries, each asked once with and once without its surroundings."""

    fixes: Sequence[LevelFix]
    world_T_true: NDArray[np.float64]
    """(fix, 4, 4) the query's true pose."""
    unseen: NDArray[np.bool_]
    """(fix,) True where the map lacked the query's surroundings."""
    block: NDArray[np.int64]
    """(fix,) the number of the query's stretch of path; fixes of one block are not independent."""

    @classmethod
    def joined(cls, parts: Sequence["LevelEvidence"]) -> "LevelEvidence":
        """The evidence of several maps, whose blocks are numbered anew."""
        fixes: list[LevelFix] = []
        world_T_true = [np.empty((0, 4, 4))]
        unseen = [np.empty(0, bool)]
        block = [np.empty(0, np.int64)]
        first_block = 0
        for part in parts:
            fixes += part.fixes
            world_T_true.append(part.world_T_true)
            unseen.append(part.unseen)
            block.append(part.block + first_block)
            first_block += int(part.block.max(initial=-1)) + 1
        return cls(
            fixes, np.concatenate(world_T_true), np.concatenate(unseen), np.concatenate(block)
        )

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return len(np.unique(self.block))

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """How much each fix (fix,) counts: together as much as `blocks` independent queries.

        Fixes of unseen places have `unseen_share` of it.
        """
        unseen_count = max(self.unseen.sum(), 1)
        seen_count = max((~self.unseen).sum(), 1)
        share = np.where(self.unseen, unseen_share, 1 - unseen_share)
        count = np.where(self.unseen, unseen_count, seen_count)
        return np.asarray(self.blocks * share / count)


@dataclass(frozen=True)
class LevelVerdict:
    """Judges the fixes of a map: by the usual judge, and by limits tested on its own evidence."""

    evidence: LevelEvidence
    """Fixes of held-out queries of this map."""
    unseen_share: float
    """The share of queries to expect from places that the map does not have."""
    judge: LevelJudge = USUAL

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which on to reject one of BELIEFS in this map.

        It is the usual limit, or a lower one where that breaks the promise on the map's own
        evidence: one building has too few blocks to promise anything by itself.
        """
        doubts, truths = self._judged(belief)
        weight = self.evidence.weight(self.unseen_share)
        limits = []
        for promise, usual_limit in zip(PROMISES, USUAL_LIMITS[belief], strict=True):
            accepted = doubts < usual_limit
            wrong = float(weight[accepted & ~truths].sum())
            is_kept = wrong <= (1 - promise) * float(weight[accepted].sum())
            lower = threshold_for(promise, doubts[accepted], truths[accepted], weight[accepted])
            limits.append(usual_limit if is_kept else lower)
        return limits

    def learned(self) -> LevelJudge:
        """A judge learned from the evidence, starting from this verdict's."""
        are_right = []
        are_near = []
        for fix, true in zip(self.evidence.fixes, self.evidence.world_T_true, strict=True):
            is_right, is_near = right(fix, true)
            are_right.append(is_right)
            are_near.append(is_near)
        all_signs = [signs(fix) for fix in self.evidence.fixes]
        weight = self.evidence.weight(self.unseen_share)
        return LevelJudge(
            learned(all_signs, are_right, weight, self.judge.pose, SCALES),
            learned(all_signs, are_near, weight, self.judge.near, SCALES),
        )

    def reached(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which on to reject one of BELIEFS, by evidence only.

        As in posing/verdict.py, the limit keeps the promise even if one more of the accepted were
        wrong. It stands in the middle of the gap to the next doubt that would break the promise,
        but is never over LARGEST_MULTIPLE times the share of wrong ones that the promise allows.
        """
        doubts, truths = self._judged(belief)
        weight = self.evidence.weight(self.unseen_share)
        limits = []
        for promise in PROMISES:
            edge = threshold_for(promise, doubts, truths, weight, 1.0)
            limits.append(min(middle(doubts, edge), LARGEST_MULTIPLE * (1 - promise)))
        return limits

    def _judged(self, belief: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubt (fix,) in one belief in each fix of the evidence, and whether it is true."""
        doubts = np.ones((len(self.evidence.fixes), len(BELIEFS)))
        truths = np.zeros(doubts.shape, bool)
        for row, fix in enumerate(self.evidence.fixes):
            ordered = fix.ordered(self.judge.pose)
            doubts[row] = self.judge.doubts(ordered).astype(np.float32)  # as they are stored
            if fix.hypotheses:
                is_right, is_near = right(ordered, self.evidence.world_T_true[row])
                truths[row] = is_right[0], is_near[0], is_right[:SEVERAL].any()
        number = BELIEFS.index(belief)
        return doubts[:, number], truths[:, number]


def right(
    fix: LevelFix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are near, by the true pose (4, 4)."""
    poses = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]).reshape(-1, 4, 4)
    away_m = np.linalg.norm(poses[:, :2, 3] - world_T_true[:2, 3], axis=1)
    return pose_is_right(poses, np.broadcast_to(world_T_true, poses.shape)), away_m < NEAR_M


def pose_is_right(
    world_T_query: NDArray[np.float64], world_T_true: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which poses (n, 4, 4) are right (n,), heights aside; a missing one (NaN) is not."""
    away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:, :2, 3], axis=1)
    _, turn_deg = distance_and_turn(world_T_query, world_T_true)
    return np.asarray((away_m < RIGHT_M) & (turn_deg < RIGHT_DEG))


def _distances_m(fix: LevelFix) -> NDArray[np.float64]:
    """The distances (n,) of all hypotheses from the best one."""
    places_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))
