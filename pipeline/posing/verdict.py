"""Verdicts: the chance that a fix is right, and when to reject it (METHODS 9.5).

In: `Evidence`, the fixes of held-out queries whose true poses are known. Out: a `Judge`, which says
for any fix how doubtful each of three BELIEFS is (that the pose is right; that the place is; that
one of several poses is); and for each belief and each of PROMISES the doubt from which on to
reject, so that among the accepted ones the promised share is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn
from pipeline.matching.rejection import threshold_for
from pipeline.posing.chances import Chances, learned
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Fix, signs

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
RIGHT_M, RIGHT_DEG = RIGHT_WITHIN
NEAR_M = 15.0
"""A place is right within this distance, as in the protocol by distance."""
SEVERAL = 3
"""Largest number of poses that are named if none alone is believed: the likeliest, and the first
runners-up elsewhere (`Fix.elsewhere`)."""
BELIEFS = ("fix", "place", "several")
"""What may be believed of a query, the strongest claim first: that its pose is right; that it is
within NEAR_M of that pose; that one of SEVERAL poses is right."""
LEAST_DOUBT = 1e-9
"""Doubts are cut off here before their log-odds are taken."""
LARGEST_MULTIPLE = 10.0
"""A belief is rejected if its doubt is more than this multiple of the share of wrong ones that a
promise allows (METHODS 9.5)."""


@dataclass(frozen=True)
class Judge:
    """Says how doubtful each belief in a fix is."""

    pose: Chances
    """The model of the chance that a hypothesis is right within RIGHT_M and RIGHT_DEG."""
    place: Chances
    """The model of the chance that a hypothesis is right within NEAR_M."""

    def doubts(self, fix: Fix) -> NDArray[np.float64]:
        """The doubt (belief,) in each of BELIEFS: one minus its chance; 1 without a hypothesis."""
        if not fix.hypotheses:
            return np.ones(len(BELIEFS))
        # Shares (hypothesis + 1,): the last is the chance that no hypothesis is right.
        fix_signs = signs(fix.hypotheses)
        pose_shares = self.pose.shares(fix_signs)
        place_shares = self.place.shares(fix_signs)
        is_far = np.append(_distances_m(fix) >= NEAR_M, True)
        is_unnamed = np.ones(len(pose_shares), bool)
        is_unnamed[_named(fix)] = False
        # Each doubt is the chance of all that the belief rules out.
        pose_doubt = pose_shares[1:].sum()
        place_doubt = place_shares[is_far].sum()
        several_doubt = pose_shares[is_unnamed].sum()
        return np.array([pose_doubt, place_doubt, several_doubt]).clip(0, 1)

    def doubts_of_all(self, fixes: Sequence[Fix]) -> NDArray[np.float64]:
        """The doubts (q, belief) of q fixes."""
        return np.array([self.doubts(fix) for fix in fixes]).reshape(len(fixes), len(BELIEFS))


@dataclass(frozen=True)
class Evidence:
    """Fixes of held-out queries: each was asked as driven, aged, and as a place never seen."""

    fixes: Sequence[Fix]
    world_T_true: Poses
    """(fix, 4, 4) the true poses."""
    unseen: NDArray[np.bool_]
    """(fix,) whether the query was asked as a place never seen: on a map without its
    surroundings."""
    block: NDArray[np.int64]
    """(fix,) the stretch of path of the query; queries of one block are not independent."""
    least_overlap: float = 0.0
    """The overlap from which on an approach was refined (Fixer.least_overlap)."""
    expectations: Expectations = field(default_factory=Expectations)
    """The signs of the right fixes, by which later fixes are judged."""

    @property
    def blocks(self) -> int:
        """The number of blocks."""
        return len(np.unique(self.block))

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """The number of independent queries (fix,) that each fix counts for.

        Together they count for as many as there are `blocks`, of which `unseen_share` are unseen.
        """
        share = np.where(self.unseen, unseen_share, 1 - unseen_share)
        unseen_count = max(self.unseen.sum(), 1)
        seen_count = max((~self.unseen).sum(), 1)
        return np.asarray(self.blocks * share / np.where(self.unseen, unseen_count, seen_count))

    def ordered(self, chances: Chances) -> "Evidence":
        """The same evidence, with the hypotheses of each fix in the order of other chances."""
        return replace(self, fixes=[Fix.of(fix.hypotheses, chances) for fix in self.fixes])

    def true(self) -> NDArray[np.bool_]:
        """Which of BELIEFS are true (fix, belief)."""
        truths = np.zeros((len(self.fixes), len(BELIEFS)), bool)
        for row, fix, world_T_true in zip(truths, self.fixes, self.world_T_true, strict=True):
            if fix.hypotheses:
                is_right, is_near = _right_and_near(fix, world_T_true)
                row[:] = is_right[0], is_near[0], is_right[_named(fix)].any()  # as in BELIEFS
        return truths


@dataclass(frozen=True)
class Verdict:
    """Learns from evidence how to judge fixes, and from which doubt on to reject them."""

    evidence: Evidence
    unseen_share: float
    """Share of queries to expect at places that the map does not have."""

    @cached_property
    def judge(self) -> Judge:
        """The judge, learned from the evidence."""
        all_signs = []
        all_right = []
        all_near = []
        for fix, world_T_true in zip(self.evidence.fixes, self.evidence.world_T_true, strict=True):
            is_right, is_near = _right_and_near(fix, world_T_true)
            all_signs.append(signs(fix.hypotheses))
            all_right.append(is_right)
            all_near.append(is_near)
        weight = self.evidence.weight(self.unseen_share)
        pose = learned(all_signs, all_right, weight)
        place = learned(all_signs, all_near, weight)
        return Judge(pose, place)

    @cached_property
    def _judged(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubts in the fixes of the evidence (fix, belief), and which beliefs are true."""
        ordered = self.evidence.ordered(self.judge.pose)
        # rounded to the type that artifacts hold
        doubts = self.judge.doubts_of_all(ordered.fixes).astype(np.float32).astype(np.float64)
        return doubts, ordered.true()

    def limits(self, belief: str) -> list[float]:
        """For each of PROMISES, the doubt from which on one of BELIEFS is rejected.

        1. Take the largest doubt at which the evidence keeps the promise, and would keep it if one
           more accepted query had been wrong: so the promise of .99 takes 99 independent accepted
           queries. That bounds the risk of a further query, as in conformal prediction
           (Angelopoulos et al., Conformal Risk Control, ICLR 2024). If no doubt keeps the promise,
           accept nothing.
        2. Move it to the middle of the gap, in log-odds, to the next query that would break it.
        3. Cut it off at LARGEST_MULTIPLE times the share of wrong ones that the promise allows: if
           much larger doubts are accepted on this day, a later day may break the promise.
        """
        column = BELIEFS.index(belief)
        all_doubts, all_true = self._judged
        doubts = all_doubts[:, column]
        true = all_true[:, column]
        weight = self.evidence.weight(self.unseen_share)
        limits = []
        for promise in PROMISES:
            edge = threshold_for(promise, doubts, true, weight, wrong_besides=1.0)
            limits.append(min(middle(doubts, edge), LARGEST_MULTIPLE * (1 - promise)))
        return limits


def middle(doubts: NDArray[np.float64], limit: float) -> float:
    """Move a limit to the middle, in log-odds, of the gap between doubts (n,) that it lies in.

    A limit below or above all of them stays.
    """
    above = doubts[doubts >= limit]
    below = doubts[doubts < limit]
    if not len(above) or not len(below):
        return limit
    lower, upper = np.array([below.max(), above.min()]).clip(LEAST_DOUBT, 1 - LEAST_DOUBT)
    return float(expit((logit(lower) + logit(upper)) / 2))


def right(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
    """Which poses (n, 4, 4) are right, given the true ones; a missing pose is not."""
    away_m, turn_deg = distance_and_turn(world_T_query, world_T_true)
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG)


def _right_and_near(
    fix: Fix, world_T_true: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which hypotheses (n,) of a fix are right, and which are within NEAR_M of the true pose."""
    world_T_query = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses]).reshape(
        -1, 4, 4
    )
    away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:2, 3], axis=1)
    return right(world_T_query, np.broadcast_to(world_T_true, world_T_query.shape)), away_m < NEAR_M


def _distances_m(fix: Fix) -> NDArray[np.float64]:
    """The distance (n,) of each hypothesis from the best one."""
    places_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in fix.hypotheses])
    return np.asarray(np.linalg.norm(places_m - places_m[0], axis=1))


def _named(fix: Fix) -> list[int]:
    """The indices of the SEVERAL hypotheses to name: the likeliest, and runners-up elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
