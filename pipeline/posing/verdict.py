"""Verdicts: the chance that a fix is right, and the doubt from which to reject it (METHODS 9.5).

Both are learned from held-out blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.core.frames import Poses, distance_and_turn
from pipeline.matching.rejection import threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Fix, signs

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
RIGHT_M = 2.0
RIGHT_DEG = 5.0
"""A fix is right within RIGHT_M and RIGHT_DEG: the field's measure."""
RIGHT_WITHIN = (RIGHT_M, RIGHT_DEG)
NEAR_M = 15.0
"""A place is right within this: the distance protocol's measure."""
SEVERAL = 3
"""So many poses at most, ELSEWHERE_M apart, are named where none alone is believed: the likeliest
and its runners-up."""
BELIEFS = ("fix", "place", "several")
"""What may be believed of a query, the most telling first: its pose; that it is within NEAR_M of
it; that it has one of SEVERAL poses."""
LEAST_DOUBT = 1e-9
TIMES = 10.0
"""No single belief is accepted whose doubt is over so many times what a promise allows in the mean
(METHODS 9.5)."""


@dataclass(frozen=True)
class Judge:
    """Gives the chance of each belief in a fix."""

    pose: Chances
    """Gives the chance that a hypothesis is right within RIGHT_M and RIGHT_DEG."""
    place: Chances
    """Gives the chance that it is within NEAR_M."""

    def doubts(self, fix: Fix) -> NDArray[np.float64]:
        """One minus the chance (belief,) of each of BELIEFS; 1 without a hypothesis."""
        if not fix.hypotheses:
            return np.ones(len(BELIEFS))
        fix_signs = signs(fix.hypotheses)
        pose_shares = self.pose.shares(fix_signs)
        place_shares = self.place.shares(fix_signs)
        far = np.append(_distances_m(fix) >= NEAR_M, True)
        unnamed = np.ones(len(pose_shares), bool)
        unnamed[_named(fix)] = False
        return np.array(
            [pose_shares[1:].sum(), place_shares[far].sum(), pose_shares[unnamed].sum()]
        ).clip(0, 1)

    def of(self, fixes: Sequence[Fix]) -> NDArray[np.float64]:
        """The doubts (q, belief) of q fixes."""
        return np.array([self.doubts(fix) for fix in fixes]).reshape(len(fixes), len(BELIEFS))


@dataclass(frozen=True)
class Evidence:
    """Fixes of held-out queries, each asked as driven, aged, and without its surroundings."""

    fixes: Sequence[Fix]
    world_T_true: Poses
    """(fix, 4, 4)."""
    unseen: NDArray[np.bool_]
    """(fix,) whether it was asked without its surroundings."""
    block: NDArray[np.int64]
    """(fix,) the stretch of path that it is of: neighbours are no independent evidence."""
    least_overlap: float = 0.0
    """From which overlap on an approach was refined (Fixer.least_overlap)."""
    expectations: Expectations = field(default_factory=Expectations)
    """The signs of the right fixes, by which later ones are judged."""

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return len(np.unique(self.block))

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """For how many of `blocks` independent queries each fix (fix,) counts.

        `unseen_share` of all count as unseen.
        """
        share = np.where(self.unseen, unseen_share, 1 - unseen_share)
        alike = np.where(self.unseen, max(self.unseen.sum(), 1), max((~self.unseen).sum(), 1))
        return np.asarray(self.blocks * share / alike)

    def ordered(self, chances: Chances) -> "Evidence":
        """The same evidence, each fix with its hypotheses in the order of other chances."""
        return replace(self, fixes=[Fix.of(fix.hypotheses, chances) for fix in self.fixes])

    def true(self) -> NDArray[np.bool_]:
        """Which of BELIEFS are true (fix, belief)."""
        truths = np.zeros((len(self.fixes), len(BELIEFS)), bool)
        for row, fix, world_T_true in zip(truths, self.fixes, self.world_T_true, strict=True):
            if fix.hypotheses:
                good, near = _right(fix, world_T_true)
                row[:] = good[0], near[0], good[_named(fix)].any()
        return truths


@dataclass(frozen=True)
class Verdict:
    """Judges fixes: the chance of each belief in one, and the doubt from which to reject it."""

    evidence: Evidence
    unseen_share: float
    """Share of queries to expect from places that the map does not have."""

    @cached_property
    def judge(self) -> Judge:
        """The judge, learned from the evidence."""
        outcomes = [
            _right(fix, true)
            for fix, true in zip(self.evidence.fixes, self.evidence.world_T_true, strict=True)
        ]
        all_signs = [signs(fix.hypotheses) for fix in self.evidence.fixes]
        weight = self.evidence.weight(self.unseen_share)
        pose = learned(all_signs, [right for right, _ in outcomes], weight)
        place = learned(all_signs, [near for _, near in outcomes], weight)
        return Judge(pose, place)

    @cached_property
    def _judged(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubts of the evidence (fix, belief), and which beliefs are true."""
        ordered = self.evidence.ordered(self.judge.pose)
        # rounded as artifacts hold them
        doubts = self.judge.of(ordered.fixes).astype(np.float32).astype(np.float64)
        return doubts, ordered.true()

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which to reject one of BELIEFS.

        It accepts nothing where no promise is kept. A promise is kept even if one more of the
        accepted had been wrong: that of .99 takes 99 independent accepted queries. So conformal
        prediction bounds the risk of a further query (Angelopoulos et al., Conformal Risk Control,
        ICLR 2024). The limit stands in the middle of the gap, in log-odds, to the next query that
        would break it. And nothing is accepted that is false more than TIMES as often as the
        promise allows in the mean: what keeps it on this day may not on a later one.
        """
        number = BELIEFS.index(belief)
        doubts = self._judged[0][:, number]
        true = self._judged[1][:, number]
        weight = self.evidence.weight(self.unseen_share)
        edges = [
            threshold_for(promise, doubts, true, weight, wrong_besides=1.0) for promise in PROMISES
        ]
        largest_doubts = [TIMES * (1 - promise) for promise in PROMISES]
        return [
            min(middle(doubts, edge), limit)
            for edge, limit in zip(edges, largest_doubts, strict=True)
        ]


def middle(doubts: NDArray[np.float64], limit: float) -> float:
    """The limit moved to the middle, in log-odds, of the gap between doubts (n,) that it stands in.

    A limit beyond all of them stays.
    """
    above = doubts[doubts >= limit]
    below = doubts[doubts < limit]
    if not len(above) or not len(below):
        return limit
    lower, upper = np.array([below.max(), above.min()]).clip(LEAST_DOUBT, 1 - LEAST_DOUBT)
    return float(expit((logit(lower) + logit(upper)) / 2))


def right(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
    """Which fixes (n, 4, 4) are right; a missing one is not."""
    away_m, turn_deg = distance_and_turn(world_T_query, world_T_true)
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG)


def _right(
    fix: Fix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are near."""
    world_T_query = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]).reshape(
        -1, 4, 4
    )
    away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:2, 3], axis=1)
    return right(world_T_query, np.broadcast_to(world_T_true, world_T_query.shape)), away_m < NEAR_M


def _distances_m(fix: Fix) -> NDArray[np.float64]:
    """The distances (n,) of all hypotheses from the best one."""
    places_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))


def _named(fix: Fix) -> list[int]:
    """The numbers of the SEVERAL poses to name: the likeliest, and the first ones elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
