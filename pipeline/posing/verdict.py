"""Verdicts: the chance that a fix is right, and where a promise is kept; from held-out blocks
(METHODS 9.5)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.frames import Poses, apart
from pipeline.matching.rejection import threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.fix import Fix, signs

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
RIGHT_M = 2.0
RIGHT_DEG = 5.0
"""A fix is right within these: the field's measure."""
NEAR_M = 15.0
"""A place is right within this: the distance protocol's measure."""
SEVERAL = 3
"""So many poses at most, ELSEWHERE_M apart, are named where none alone is believed: the likeliest
and its runners-up."""
BELIEFS = ("fix", "place", "several")
"""What may be believed of a query, the most telling first: its pose; that it is within NEAR_M of
it; that it has one of SEVERAL poses."""
LEAST_DOUBT = 1e-9
TIMES = 5.0
"""No single belief is accepted whose doubt is over so many times what a promise allows in the mean
(METHODS 9.5)."""


@dataclass(frozen=True)
class Judge:
    """What a site believes of a fix."""

    pose: Chances
    """That a hypothesis is right within RIGHT_M and RIGHT_DEG."""
    place: Chances
    """That it is within NEAR_M."""

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
        """(q, belief) of q fixes."""
        return np.array([self.doubts(fix) for fix in fixes]).reshape(len(fixes), len(BELIEFS))


@dataclass(frozen=True)
class Evidence:
    """Fixes of held-out queries, each asked several times: as driven, aged, and without its
    surroundings."""

    fixes: Sequence[Fix]
    world_T_true: Poses
    """(fix, 4, 4)."""
    unseen: NDArray[np.bool_]
    """(fix,) asked without its surroundings."""
    block: NDArray[np.int64]
    """(fix,) the stretch of path that it is of: neighbours are no independent evidence."""

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Of several sets of blocks, none of which is of another."""
        numbers = np.cumsum([0, *(part.block.max(initial=-1) + 1 for part in parts)])
        block = [part.block + first for part, first in zip(parts, numbers, strict=False)]
        true, unseen = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("world_T_true", "unseen")
        )
        return cls(
            [fix for part in parts for fix in part.fixes], true, unseen, np.concatenate(block)
        )

    @property
    def blocks(self) -> int:
        """How many there are."""
        return len(np.unique(self.block))

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """(fix,) for how many of `blocks` independent queries each counts, if such a share of all
        is unseen."""
        share = np.where(self.unseen, unseen_share, 1 - unseen_share)
        alike = np.where(self.unseen, max(self.unseen.sum(), 1), max((~self.unseen).sum(), 1))
        return np.asarray(self.blocks * share / alike)

    def ordered(self, chances: Chances) -> "Evidence":
        """The same with the hypotheses of each fix in the order of other chances."""
        return replace(self, fixes=[Fix.of(fix.hypotheses, chances) for fix in self.fixes])

    def true(self) -> NDArray[np.bool_]:
        """(fix, belief) which of BELIEFS are true."""
        found = np.zeros((len(self.fixes), len(BELIEFS)), bool)
        for row, fix, world_T_true in zip(found, self.fixes, self.world_T_true, strict=True):
            if fix.hypotheses:
                good, near = _right(fix, world_T_true)
                row[:] = good[0], near[0], good[_named(fix)].any()
        return found


@dataclass(frozen=True)
class Verdict:
    """Tells the chance of each belief in a fix, and from which doubt on to reject it."""

    evidence: Evidence
    unseen_share: float
    """Share of queries to expect from places that the map does not have."""

    @cached_property
    def judge(self) -> Judge:
        """Learned from the evidence."""
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
        doubts = (
            self.judge.of(ordered.fixes).astype(np.float32).astype(np.float64)
        )  # as artifacts hold them
        return doubts, ordered.true()

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES the doubt from which to reject one of BELIEFS; it accepts nothing
        where no promise is kept.

        A promise is kept even if one more of the accepted had been wrong: that of .99 takes 99
        independent accepted queries. So conformal prediction bounds the risk of a further query
        (Angelopoulos et al., Conformal Risk Control, ICLR 2024). The limit stands in the middle of
        the gap, in log-odds, to the next query that would break it. And nothing is accepted that is
        false more than TIMES as often as the promise allows in the mean: what keeps it on this day
        may not on a later one.
        """
        number = BELIEFS.index(belief)
        doubts = self._judged[0][:, number]
        true = self._judged[1][:, number]
        weight = self.evidence.weight(self.unseen_share)
        edges = [
            threshold_for(promise, doubts, true, weight, wrong_besides=1.0) for promise in PROMISES
        ]
        most = [TIMES * (1 - promise) for promise in PROMISES]
        return [min(middle(doubts, edge), limit) for edge, limit in zip(edges, most, strict=True)]


def middle(doubts: NDArray[np.float64], limit: float) -> float:
    """The limit in the middle, in log-odds, of the gap that it stands in between doubts (n,);
    itself beyond all of them."""
    above = doubts[doubts >= limit]
    below = doubts[doubts < limit]
    if not len(above) or not len(below):
        return limit
    least, most = np.array([below.max(), above.min()]).clip(LEAST_DOUBT, 1 - LEAST_DOUBT)
    return float(expit((logit(least) + logit(most)) / 2))


def right(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
    """Which fixes (n, 4, 4) are right; a missing one is not."""
    away_m, turn_deg = apart(world_T_query, world_T_true)
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG)


def _right(
    fix: Fix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are near."""
    found = np.array([one.world_T_query for one in fix.hypotheses]).reshape(-1, 4, 4)
    away_m = np.linalg.norm(found[:, :2, 3] - world_T_true[:2, 3], axis=1)
    return right(found, np.broadcast_to(world_T_true, found.shape)), away_m < NEAR_M


def _distances_m(fix: Fix) -> NDArray[np.float64]:
    """Of the hypotheses (n,) from the best one."""
    places_m = np.array([one.world_T_query[:2, 3] for one in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))


def _named(fix: Fix) -> list[int]:
    """The numbers of the SEVERAL poses that a robot is told: the likeliest, and the first that
    stand elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
