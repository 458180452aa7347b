"""Verdicts: the chance that a fix is right, and when to reject it (METHODS 9.5, 13.4).

In: `Evidence`, the fixes of held-out queries whose true poses are known. Out: a `Judge`, which says
for any fix how doubtful each of three BELIEFS is (that the pose is right; that the place is; that
one of several poses is); and a `Verdict`: for each belief and each of PROMISES the doubt from which
on to reject, so that among the accepted ones the promised share is right. Fixes of 3-D scans and of
level sweeps are judged alike, within other `Tolerances`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn
from pipeline.matching.rejection import threshold_for
from pipeline.posing import chances
from pipeline.posing.chances import Chances, learned
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Registered

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
SEVERAL = 3
"""Largest number of poses that are named if none alone is believed: the likeliest, and the first
runners-up elsewhere (`Registered.elsewhere`)."""
BELIEFS = ("fix", "place", "several")
"""What may be believed of a query, the strongest claim first: that its pose is right; that it is
near that pose; that one of SEVERAL poses is right."""
LEAST_DOUBT = 1e-9
"""Doubts are cut off here before their log-odds are taken."""
AnyFix = Registered[Any]
"""A fix of a 3-D scan or of level sweeps."""
FixT_co = TypeVar("FixT_co", bound=AnyFix, covariant=True)
Beliefs = Mapping[str, tuple[float, ...]]
"""For each of BELIEFS the doubts from which on to reject it, one for each promise."""


@dataclass(frozen=True)
class Tolerances:
    """How far a pose may be off, and how much doubt a promise allows."""

    right_within: tuple[float, float]
    """A pose is right within these metres and degrees."""
    near_m: float
    """A place is right within this distance."""
    largest_multiple: float
    """A belief is rejected if its doubt is more than this multiple of the share of wrong ones that
    a promise allows (METHODS 9.5)."""
    scales: NDArray[np.float64] = field(compare=False)
    """(sign,) a usual difference of each sign, by which learned weights are scaled."""
    is_level: bool = False
    """Whether heights are left aside."""

    def right(self, world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
        """Which poses (n, 4, 4) are right, given the true ones; a missing pose is not."""
        right_m, right_deg = self.right_within
        away_m, turn_deg = distance_and_turn(world_T_query, world_T_true)
        if self.is_level:
            away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:, :2, 3], axis=1)
        return np.asarray((away_m < right_m) & (turn_deg < right_deg))

    def right_and_near(
        self, fix: AnyFix, world_T_true: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which hypotheses (n,) of a fix are right, and which near, by the true pose (4, 4)."""
        poses = fix.poses
        away_m = np.linalg.norm(poses[:, :2, 3] - world_T_true[:2, 3], axis=1)
        is_right = self.right(poses, np.broadcast_to(world_T_true, poses.shape))
        return is_right, away_m < self.near_m


OF_SCANS = Tolerances(RIGHT_WITHIN, near_m=15.0, largest_multiple=10.0, scales=chances.SCALES)
"""The tolerances of 3-D scans."""


@dataclass(frozen=True)
class Judge:
    """Says how doubtful each belief in a fix is."""

    pose: Chances
    """The model of the chance that a hypothesis is right."""
    place: Chances
    """The model of the chance that a hypothesis is near."""
    tolerances: Tolerances = OF_SCANS

    def doubts(self, fix: AnyFix) -> NDArray[np.float64]:
        """The doubt (belief,) in each of BELIEFS: one minus its chance; 1 without a hypothesis."""
        if not fix.hypotheses:
            return np.ones(len(BELIEFS))
        # Shares (hypothesis + 1,): the last is the chance that no hypothesis is right.
        fix_signs = fix.signs
        pose_shares = self.pose.shares(fix_signs)
        place_shares = self.place.shares(fix_signs)
        places_m = fix.poses[:, :2, 3]
        is_far = np.linalg.norm(places_m - places_m[0], axis=1) >= self.tolerances.near_m
        is_unnamed = np.ones(len(pose_shares), bool)
        is_unnamed[_named(fix)] = False
        # Each doubt is the chance of all that the belief rules out.
        pose_doubt = pose_shares[1:].sum()
        place_doubt = place_shares[np.append(is_far, True)].sum()
        several_doubt = pose_shares[is_unnamed].sum()
        return np.array([pose_doubt, place_doubt, several_doubt]).clip(0, 1)


USUAL = Judge(chances.USUAL, chances.USUAL)
"""The judge of 3-D scans that learning starts from."""


@dataclass(frozen=True)
class Verdict:
    """When to believe the fixes of a site: chances of beliefs, and limits of the doubt in each."""

    pose: Chances
    """Gives the chance that a pose is right."""
    place: Chances
    """Gives the chance that the robot is near a pose."""
    promises: tuple[float, ...]
    """The precisions that were tried; those `kept` a user may ask for."""
    promised: Beliefs
    """For each of BELIEFS and each promise, the doubt from which on to reject to keep the promise.
    Where it is not above 0 the promise cannot be kept."""
    held_out: int
    """The number of held-out blocks of the training day that the limits rest on."""
    unseen_share: float
    """The share of queries that are expected where training never went."""

    @property
    def kept(self) -> tuple[float, ...]:
        """The precisions that can be promised of a pose."""
        return tuple(self.limits)

    @property
    def limits(self) -> dict[float, tuple[float, ...]]:
        """For each precision that can be promised of a pose, the limits of doubts in BELIEFS."""
        limits_of_beliefs = [self.promised[belief] for belief in BELIEFS]
        limits = zip(self.promises, zip(*limits_of_beliefs, strict=True), strict=True)
        return {promise: of_beliefs for promise, of_beliefs in limits if of_beliefs[0] > 0}


@dataclass(frozen=True)
class Evidence(Generic[FixT_co]):
    """Fixes of held-out queries, each asked in several ways; one of them as a place never seen."""

    fixes: Sequence[FixT_co]
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

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The evidence of several maps, whose blocks are numbered on."""
        fixes: list[FixT_co] = []
        blocks = [np.empty(0, np.int64)]
        first_block = 0
        for part in parts:
            fixes += part.fixes
            blocks.append(part.block + first_block)
            first_block += int(part.block.max(initial=-1)) + 1
        world_T_true = np.concatenate([np.empty((0, 4, 4)), *(part.world_T_true for part in parts)])
        unseen = np.concatenate([np.empty(0, bool), *(part.unseen for part in parts)])
        return cls(fixes, world_T_true, unseen, np.concatenate(blocks))

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

    def learned(self, unseen_share: float, start: Judge = USUAL) -> Judge:
        """A judge learned from the fixes, starting from another."""
        tolerances = start.tolerances
        all_signs = [fix.signs for fix in self.fixes]
        truths = [
            tolerances.right_and_near(fix, world_T_true)
            for fix, world_T_true in zip(self.fixes, self.world_T_true, strict=True)
        ]
        are_right = [is_right for is_right, _ in truths]
        are_near = [is_near for _, is_near in truths]
        weight = self.weight(unseen_share)
        return replace(
            start,
            pose=learned(all_signs, are_right, weight, start.pose, tolerances.scales),
            place=learned(all_signs, are_near, weight, start.place, tolerances.scales),
        )

    def judged(self, judge: Judge) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The doubts (fix, belief) in the fixes, and which beliefs are true."""
        doubts = np.ones((len(self.fixes), len(BELIEFS)))
        truths = np.zeros(doubts.shape, bool)
        for row, (fix, world_T_true) in enumerate(zip(self.fixes, self.world_T_true, strict=True)):
            ordered = fix.ordered(judge.pose)
            doubts[row] = judge.doubts(ordered).astype(np.float32)  # as artifacts hold them
            if fix.hypotheses:
                is_right, is_near = judge.tolerances.right_and_near(ordered, world_T_true)
                truths[row] = is_right[0], is_near[0], is_right[_named(ordered)].any()
        return doubts, truths

    def limits(self, judge: Judge, unseen_share: float) -> Beliefs:
        """For each of BELIEFS and of PROMISES, the doubt from which on a belief is rejected.

        1. Take the largest doubt at which the evidence keeps the promise, and would keep it if one
           more accepted query had been wrong: so the promise of .99 takes 99 independent accepted
           queries. That bounds the risk of a further query, as in conformal prediction
           (Angelopoulos et al., Conformal Risk Control, ICLR 2024). If no doubt keeps the promise,
           accept nothing.
        2. Move it to the middle of the gap, in log-odds, to the next query that would break it.
        3. Cut it off at the `largest_multiple` of the share of wrong ones that the promise allows:
           if much larger doubts are accepted on this day, a later day may break the promise.
        """
        all_doubts, all_true = self.judged(judge)
        weight = self.weight(unseen_share)
        limits = {}
        for belief, doubts, true in zip(BELIEFS, all_doubts.T, all_true.T, strict=True):
            edges = [threshold_for(promise, doubts, true, weight, 1.0) for promise in PROMISES]
            limits[belief] = tuple(
                min(middle(doubts, edge), judge.tolerances.largest_multiple * (1 - promise))
                for promise, edge in zip(PROMISES, edges, strict=True)
            )
        return limits

    def verdict(self, unseen_share: float) -> Verdict:
        """The verdict on fixes of 3-D scans, learned from these."""
        judge = self.learned(unseen_share)
        limits = self.limits(judge, unseen_share)
        return Verdict(judge.pose, judge.place, PROMISES, limits, self.blocks, unseen_share)


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


def _named(fix: AnyFix) -> list[int]:
    """The indices of the SEVERAL hypotheses to name: the likeliest, and runners-up elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
