"""Verdicts: the probability that a fix is right, and when to reject it (METHODS 9.5, 13.4).

In: `FixEvidence`, the fixes of validation queries whose true poses are known. Out: a `Judge`, which
says for any fix the error probability of each of three claims (that the pose is right; that the
place is; that one of several poses is); and a `Verdict`: for each claim and each of
TARGET_PRECISIONS the error probability from which on to reject, so that the target share of the
accepted ones is right. Fixes of 3-D scans and of level sweeps are judged in the same way, within
other `Tolerances`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn
from pipeline.matching.rejection import threshold_for
from pipeline.posing import probabilities
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Registered
from pipeline.posing.probabilities import Probabilities, learned

TARGET_PRECISIONS = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
SEVERAL = 3
"""Largest number of poses that are named if none alone is accepted: the likeliest, and the first
runners-up elsewhere (`Registered.elsewhere`)."""
CLAIMS = ("fix", "place", "several")
"""What may be accepted of a query, the strongest claim first: that its pose is right; that it is
near that pose; that one of SEVERAL poses is right."""
LEAST_ERROR_PROBABILITY = 1e-9
"""Error probabilities are cut off here before their log-odds are taken."""
AnyFix = Registered[Any]
"""A fix of a 3-D scan or of level sweeps."""
FixT_co = TypeVar("FixT_co", bound=AnyFix, covariant=True)
ClaimThresholds = Mapping[str, tuple[float, ...]]
"""For each of CLAIMS the error probabilities from which on to reject it, one for each target
precision."""


@dataclass(frozen=True)
class Tolerances:
    """How far a pose may be off, and how much error probability a target precision allows."""

    right_within: tuple[float, float]
    """A pose is right within these metres and degrees."""
    near_m: float
    """A place is right within this distance."""
    largest_multiple: float
    """A claim is rejected if its error probability is more than this multiple of the share of wrong
    ones that a target precision allows (METHODS 9.5)."""
    scales: NDArray[np.float64] = field(compare=False)
    """(feature,) a usual difference of each feature, by which learned weights are scaled."""
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


OF_SCANS = Tolerances(RIGHT_WITHIN, near_m=15.0, largest_multiple=10.0, scales=probabilities.SCALES)
"""The tolerances of 3-D scans."""


@dataclass(frozen=True)
class Judge:
    """Says the error probability of each of three claims."""

    pose: Probabilities
    """The model of the probability that a hypothesis is right."""
    place: Probabilities
    """The model of the probability that a hypothesis is near."""
    tolerances: Tolerances = OF_SCANS

    def error_probabilities(self, fix: AnyFix) -> NDArray[np.float64]:
        """The error probability (claim,) in each of CLAIMS: one minus its probability; 1 without a
        hypothesis."""
        if not fix.hypotheses:
            return np.ones(len(CLAIMS))
        # Shares (hypothesis + 1,): the last is the probability that no hypothesis is right.
        fix_features = fix.features
        pose_shares = self.pose.shares(fix_features)
        place_shares = self.place.shares(fix_features)
        places_m = fix.poses[:, :2, 3]
        is_far = np.linalg.norm(places_m - places_m[0], axis=1) >= self.tolerances.near_m
        is_unnamed = np.ones(len(pose_shares), bool)
        is_unnamed[_named(fix)] = False
        # Each error probability is the probability of all that the claim rules out.
        pose_error_probability = pose_shares[1:].sum()
        place_error_probability = place_shares[np.append(is_far, True)].sum()
        several_error_probability = pose_shares[is_unnamed].sum()
        return np.array(
            [pose_error_probability, place_error_probability, several_error_probability]
        ).clip(0, 1)


USUAL = Judge(probabilities.USUAL, probabilities.USUAL)
"""The judge of 3-D scans that learning starts from."""


@dataclass(frozen=True)
class Verdict:
    """When to accept the fixes of a site: probabilities of claims, and thresholds of the error
    probability in each."""

    pose: Probabilities
    """Gives the probability that a pose is right."""
    place: Probabilities
    """Gives the probability that the robot is near a pose."""
    target_precisions: tuple[float, ...]
    """The precisions that were tried; those `kept` a user may ask for."""
    claim_thresholds: ClaimThresholds
    """For each of CLAIMS and each target precision, the error probability from which on to reject
    to reach the target precision. Where it is not above 0 the target precision cannot be kept."""
    validation: int
    """The number of validation blocks of the training day that the thresholds rest on."""
    unseen_share: float
    """The share of queries that are expected where training never went."""

    @property
    def kept(self) -> tuple[float, ...]:
        """The target precisions that poses can reach."""
        return tuple(self.thresholds)

    @property
    def thresholds(self) -> dict[float, tuple[float, ...]]:
        """For each target precision that a pose can reach, the thresholds of error probabilities in
        CLAIMS."""
        thresholds_of_claims = [self.claim_thresholds[claim] for claim in CLAIMS]
        thresholds = zip(
            self.target_precisions, zip(*thresholds_of_claims, strict=True), strict=True
        )
        return {
            target_precision: of_claims
            for target_precision, of_claims in thresholds
            if of_claims[0] > 0
        }


@dataclass(frozen=True)
class FixEvidence(Generic[FixT_co]):
    """Fixes of validation queries, each asked in several ways; one of them as a place never
    seen."""

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
    """The features of the right fixes, by which later fixes are judged."""

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
        all_features = [fix.features for fix in self.fixes]
        ground_truths = [
            tolerances.right_and_near(fix, world_T_true)
            for fix, world_T_true in zip(self.fixes, self.world_T_true, strict=True)
        ]
        are_right = [is_right for is_right, _ in ground_truths]
        are_near = [is_near for _, is_near in ground_truths]
        weight = self.weight(unseen_share)
        return replace(
            start,
            pose=learned(all_features, are_right, weight, start.pose, tolerances.scales),
            place=learned(all_features, are_near, weight, start.place, tolerances.scales),
        )

    def judged(self, judge: Judge) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The error probabilities (fix, claim) in the fixes, and which claims are true."""
        error_probabilities = np.ones((len(self.fixes), len(CLAIMS)))
        ground_truths = np.zeros(error_probabilities.shape, bool)
        for row, (fix, world_T_true) in enumerate(zip(self.fixes, self.world_T_true, strict=True)):
            ordered = fix.ordered(judge.pose)
            error_probabilities[row] = judge.error_probabilities(ordered).astype(
                np.float32
            )  # as artifacts hold them
            if fix.hypotheses:
                is_right, is_near = judge.tolerances.right_and_near(ordered, world_T_true)
                ground_truths[row] = is_right[0], is_near[0], is_right[_named(ordered)].any()
        return error_probabilities, ground_truths

    def thresholds(self, judge: Judge, unseen_share: float) -> ClaimThresholds:
        """For each of CLAIMS and of TARGET_PRECISIONS, the error probability from which on a claim
        is rejected.

        1. Take the largest error probability at which the evidence reaches the target precision,
           and would keep it if one more accepted query had been wrong: so the target precision .99
           takes 99 independent accepted queries. That bounds the risk of a further query, as in
           conformal prediction (Angelopoulos et al., Conformal Risk Control, ICLR 2024). If no
           error probability reaches the target precision, accept nothing.
        2. Move it to the middle of the gap, in log-odds, to the next query that would break it.
        3. Cut it off at the `largest_multiple` of the share of wrong ones that the target precision
           allows: if much larger error probabilities are accepted on this day, a later day may
           misses the target precision.
        """
        all_error_probabilities, all_true = self.judged(judge)
        weight = self.weight(unseen_share)
        thresholds = {}
        for claim, error_probabilities, true in zip(
            CLAIMS, all_error_probabilities.T, all_true.T, strict=True
        ):
            edges = [
                threshold_for(target_precision, error_probabilities, true, weight, 1.0)
                for target_precision in TARGET_PRECISIONS
            ]
            thresholds[claim] = tuple(
                min(
                    middle(error_probabilities, edge),
                    judge.tolerances.largest_multiple * (1 - target_precision),
                )
                for target_precision, edge in zip(TARGET_PRECISIONS, edges, strict=True)
            )
        return thresholds

    def verdict(self, unseen_share: float) -> Verdict:
        """The verdict on fixes of 3-D scans, learned from these."""
        judge = self.learned(unseen_share)
        thresholds = self.thresholds(judge, unseen_share)
        return Verdict(
            judge.pose, judge.place, TARGET_PRECISIONS, thresholds, self.blocks, unseen_share
        )


def middle(error_probabilities: NDArray[np.float64], threshold: float) -> float:
    """Move a threshold to the middle, in log-odds, of the gap between error probabilities (n,) that
    it lies in.

    A threshold below or above all of them stays.
    """
    above = error_probabilities[error_probabilities >= threshold]
    below = error_probabilities[error_probabilities < threshold]
    if not len(above) or not len(below):
        return threshold
    lower, upper = np.array([below.max(), above.min()]).clip(
        LEAST_ERROR_PROBABILITY, 1 - LEAST_ERROR_PROBABILITY
    )
    return float(expit((logit(lower) + logit(upper)) / 2))


def _named(fix: AnyFix) -> list[int]:
    """The indices of the SEVERAL hypotheses to name: the likeliest, and runners-up elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
