"""Verdicts: the probability that a fix is right, and when to reject it (METHODS 9.5, 13.4).

In: `FixEvidence`, the fixes of validation queries whose true poses are known. Out:

- a `Judge`: it computes, for any fix, the error probability of each of three claims: the pose is
  right; the query is near the pose; one of several poses is right;
- a `Verdict`: it holds, for each claim and each of TARGET_PRECISIONS, the threshold of the error
  probability from which on the claim is rejected, so that the accepted claims reach this precision.

Fixes of 3-D scans and of level sweeps are judged in the same way, within different `Tolerances`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit

from pipeline.core.errors import InputError
from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn
from pipeline.core.precisions import kept_precision, kept_words
from pipeline.matching.rejection import ACCEPT_NOTHING, threshold_for
from pipeline.posing import covariances, probabilities
from pipeline.posing.covariances import CovarianceModel, pose_errors
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Registered
from pipeline.posing.probabilities import HypothesisModel, learned

TARGET_PRECISIONS = (0.9, 0.95, 0.97, 0.98, 0.985, 0.99, 0.995, 0.999)
"""The target precisions, ascending: shares of right fixes among the accepted fixes."""
SEVERAL = 5
"""Largest number of poses that are reported if no single pose is accepted: the likeliest pose, and
the first runners-up elsewhere (`Registered.elsewhere`)."""
CLAIMS = ("fix", "place", "several")
"""The claims about a query, the strongest first: its likeliest pose is right; it is near this pose;
one of SEVERAL poses is right."""
LARGEST_ERROR_PROBABILITY = 0.5
"""No claim that is more likely wrong than right is accepted, at any target precision."""
LEAST_ERROR_PROBABILITY = 1e-9
"""Error probabilities are clipped to this and one minus this before their log-odds are taken."""
LEAST_PROBABILITY = 0.9
"""Covariances are learned from fixes of at least this probability: accepted fixes have it."""
AnyFix = Registered[Any]
"""A fix of a 3-D scan or of level sweeps."""
FixT_co = TypeVar("FixT_co", bound=AnyFix, covariant=True)
ClaimThresholds = Mapping[str, tuple[float, ...]]
"""For each of CLAIMS and each target precision, the error probability from which on the claim is
rejected."""


@dataclass(frozen=True)
class Tolerances:
    """How far a right pose may be off, and which error probabilities may be accepted."""

    right_within: tuple[float, float]
    """A pose is right within these metres and degrees of the true pose."""
    near_m: float
    """A pose is near within this distance from the true pose."""
    largest_multiple: float
    """A claim is rejected if its error probability exceeds this multiple of one minus the target
    precision (METHODS 9.5)."""
    scales: NDArray[np.float64] = field(compare=False)
    """(feature,) a typical difference of each feature; learning divides features by it."""
    is_level: bool = False
    """Whether heights are ignored."""

    def right(self, world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
        """Which poses (n, 4, 4) are right, given the true poses; a missing pose is not right."""
        right_m, right_deg = self.right_within
        away_m, turn_deg = distance_and_turn(world_T_query, world_T_true)
        if self.is_level:
            away_m = np.linalg.norm(world_T_query[:, :2, 3] - world_T_true[:, :2, 3], axis=1)
        return np.asarray((away_m < right_m) & (turn_deg < right_deg))

    def right_and_near(
        self, fix: AnyFix, world_T_true: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which hypotheses (n,) of a fix are right, and which are near, given the true pose."""
        poses = fix.poses
        away_m = np.linalg.norm(poses[:, :2, 3] - world_T_true[:2, 3], axis=1)
        is_right = self.right(poses, np.broadcast_to(world_T_true, poses.shape))
        return is_right, away_m < self.near_m


OF_SCANS = Tolerances(RIGHT_WITHIN, near_m=15.0, largest_multiple=15.0, scales=probabilities.SCALES)
"""The tolerances of 3-D scans."""


@dataclass(frozen=True)
class Judge:
    """Computes the error probability of each claim about a fix."""

    pose: HypothesisModel
    """The model of the probability that a hypothesis is right."""
    place: HypothesisModel
    """The model of the probability that a hypothesis is near."""
    tolerances: Tolerances = OF_SCANS

    def error_probabilities(self, fix: AnyFix) -> NDArray[np.float64]:
        """The error probability (claim,) of each of CLAIMS: one minus the claim's probability.

        It is 1 for a fix without a hypothesis.
        """
        if not fix.hypotheses:
            return np.ones(len(CLAIMS))
        # Both are (hypothesis + 1,): the last entry is that no hypothesis is right, or near.
        features = fix.features
        pose_probabilities = self.pose.probabilities_and_none(features, fix.log_weights)
        place_probabilities = self.place.probabilities_and_none(features, fix.log_weights)
        xy_m = fix.poses[:, :2, 3]
        is_far = np.linalg.norm(xy_m - xy_m[0], axis=1) >= self.tolerances.near_m
        is_unreported = np.ones(len(pose_probabilities), bool)
        is_unreported[_reported(fix)] = False
        # Each error probability is the sum over the cases that the claim excludes.
        pose_error = pose_probabilities[1:].sum()
        place_error = place_probabilities[np.append(is_far, True)].sum()
        several_error = pose_probabilities[is_unreported].sum()
        return np.array([pose_error, place_error, several_error]).clip(0, 1)


USUAL = Judge(probabilities.USUAL, probabilities.USUAL)
"""The judge of 3-D scans that learning starts from."""


@dataclass(frozen=True)
class Verdict:
    """When to accept the fixes of a site: the models of a judge, and a threshold for each claim."""

    pose: HypothesisModel
    """The model of the probability that a pose is right."""
    place: HypothesisModel
    """The model of the probability that the robot is near a pose."""
    target_precisions: tuple[float, ...]
    """The target precisions that were tried; a user may choose among those that are `reachable`."""
    claim_thresholds: ClaimThresholds
    """For each of CLAIMS and each target precision, the error probability from which on the claim
    is rejected. A threshold that is not above 0 marks a target precision that cannot be reached."""
    validation_blocks: int
    """The number of validation blocks of the training day that the thresholds were learned from."""
    unseen_share: float
    """The expected share of queries where training never went."""
    usual: tuple[float, ...] = ()
    """The target precisions whose thresholds are those of all maps: this map's own validation
    blocks are too few, or none, to learn them."""
    covariances: CovarianceModel | None = None
    """Calibrates the covariances of poses; None for level sweeps, which have no such model."""

    def calibrated(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """The calibrated covariances of covariances (…, 6, 6)."""
        return self.covariances.calibrated(covariance) if self.covariances else covariance

    @property
    def reachable(self) -> tuple[float, ...]:
        """The target precisions that poses can reach."""
        return tuple(self.thresholds)

    @property
    def thresholds(self) -> dict[float, tuple[float, ...]]:
        """For each target precision that poses can reach, the thresholds (claim,) of CLAIMS."""
        by_claim = [self.claim_thresholds[claim] for claim in CLAIMS]
        by_precision = zip(*by_claim, strict=True)
        return {
            target_precision: thresholds
            for target_precision, thresholds in zip(
                self.target_precisions, by_precision, strict=True
            )
            if thresholds[0] > 0
        }

    def kept_precision(self, wanted: float | None, strict: bool = False) -> float | None:
        """The precision that `accepted` means if a precision is wanted; None accepts nothing.

        It is the least reachable one from the wanted one on, or else the largest. Raises InputError
        for a wanted precision that is not a share; if `strict`, for each that is not reachable.
        """
        kept = kept_precision(self.reachable, wanted)
        if strict and wanted is not None and kept != wanted:
            possible = "nor for any other; choose none"
            if self.reachable:
                possible = (
                    f"it has thresholds for {', '.join(map(str, self.reachable))}; choose one of "
                    f"these, such as --target-precision {kept}"
                )
            raise InputError(
                f"target_precision={wanted:g}: this site has no threshold for it; {possible}"
            )
        return kept

    def kept_words(self, wanted: float | None) -> str | None:
        """A line that says what is kept instead of a wanted precision; None if that is kept."""
        why = f"its {self.validation_blocks} validation blocks are too few, or too often wrong"
        if not self.validation_blocks:
            why = "it has no validation blocks"
        return kept_words("this site", self.reachable, wanted, why)


@dataclass(frozen=True)
class FixEvidence(Generic[FixT_co]):
    """The fixes of validation queries. Each query was fixed in several ways, one of them on a map
    without its surroundings."""

    fixes: Sequence[FixT_co]
    world_T_true: Poses
    """(fix, 4, 4) the true poses."""
    unseen: NDArray[np.bool_]
    """(fix,) whether the map lacked the query's surroundings, so that the place was novel."""
    block: NDArray[np.int64]
    """(fix,) the number of the query's block, a stretch of path; queries of one block are not
    independent."""
    least_overlap: float = 0.0
    """Approaches with at least this overlap were refined (Fixer.least_overlap)."""
    expectations: Expectations = field(default_factory=Expectations)
    """The features of the right fixes, by which later fixes are judged."""

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The evidence of several maps together, with consecutive numbers of blocks."""
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
        """The number of independent queries that each fix (fix,) counts for.

        All fixes together count for as many queries as there are `blocks`, and the unseen fixes for
        the share `unseen_share` of them.
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
        """The error probability (fix, claim) of each claim, and whether the claim is true."""
        error_probabilities = np.ones((len(self.fixes), len(CLAIMS)))
        ground_truths = np.zeros(error_probabilities.shape, bool)
        for row, (fix, world_T_true) in enumerate(zip(self.fixes, self.world_T_true, strict=True)):
            ordered = fix.ordered(judge.pose)
            # rounded to float32, as in artifacts
            error_probabilities[row] = judge.error_probabilities(ordered).astype(np.float32)
            if fix.hypotheses:
                is_right, is_near = judge.tolerances.right_and_near(ordered, world_T_true)
                ground_truths[row] = is_right[0], is_near[0], is_right[_reported(ordered)].any()
        return error_probabilities, ground_truths

    def thresholds(self, judge: Judge, unseen_share: float) -> ClaimThresholds:
        """For each of CLAIMS and of TARGET_PRECISIONS, the error probability from which on a claim
        is rejected.

        1. Take the largest error probability at which the evidence reaches the target precision,
           with one extra accepted query counted as wrong. So even without a mistake a target
           precision of .99 takes 99 independent accepted queries (99 of 100). This bounds the risk
           of a further query, as in conformal prediction (Angelopoulos et al., Conformal Risk
           Control, ICLR 2024). If no error probability reaches the target precision, accept
           nothing.
        2. Move the threshold to the middle, in log-odds, of the gap to the next larger error
           probability among the queries, which would miss the target precision.
        3. Limit it to `largest_multiple` times one minus the target precision, and to
           LARGEST_ERROR_PROBABILITY: if claims of much larger error probabilities are accepted, a
           later day may miss the target precision.
        """
        error_probabilities, is_true = self.judged(judge)
        weight = self.weight(unseen_share)
        thresholds = {}
        for claim, of_claim, is_true_of_claim in zip(
            CLAIMS, error_probabilities.T, is_true.T, strict=True
        ):
            edges = [
                threshold_for(target_precision, of_claim, is_true_of_claim, weight, 1.0)
                for target_precision in TARGET_PRECISIONS
            ]
            thresholds[claim] = never_above_lower(
                [
                    min(
                        middle(of_claim, edge),
                        judge.tolerances.largest_multiple * (1 - target_precision),
                        LARGEST_ERROR_PROBABILITY,
                    )
                    for target_precision, edge in zip(TARGET_PRECISIONS, edges, strict=True)
                ]
            )
        return thresholds

    def verdict(self, unseen_share: float, start: Judge = USUAL) -> Verdict:
        """The verdict on fixes of 3-D scans, learned from this evidence, starting from a judge."""
        judge = self.learned(unseen_share, start)
        thresholds = self.thresholds(judge, unseen_share)
        return Verdict(
            judge.pose,
            judge.place,
            TARGET_PRECISIONS,
            thresholds,
            self.blocks,
            unseen_share,
            covariances=self.covariance_model(judge),
        )

    def covariance_model(
        self, judge: Judge, start: CovarianceModel = covariances.USUAL
    ) -> CovarianceModel:
        """The model of covariances learned from the fixes of 3-D scans, starting from another.

        It learns from right fixes at known places, of a probability as accepted fixes have it. If
        these are too few, it is `start` itself.
        """
        fixes = [fix.ordered(judge.pose) for fix in self.fixes]
        poses = np.array([fix.pose for fix in fixes]).reshape(-1, 4, 4)
        probabilities = np.array([fix.probability for fix in fixes])
        is_right = judge.tolerances.right(poses, self.world_T_true)
        rows = np.flatnonzero(is_right & ~self.unseen & (probabilities >= LEAST_PROBABILITY))
        return CovarianceModel.learned(
            pose_errors(poses[rows], self.world_T_true[rows]),
            np.array([fixes[row].covariance for row in rows]).reshape(-1, 6, 6),
            np.full(len(rows), self.blocks / max(len(rows), 1)),
            start,
        )


def usual_thresholds(measured: Mapping[float, float]) -> tuple[float, ...]:
    """The threshold of each of TARGET_PRECISIONS, from those of the measured target precisions.

    A target precision that was not measured has the threshold of the least measured one above it,
    which is stricter; if there is none, it accepts nothing.
    """
    thresholds = []
    for target_precision in TARGET_PRECISIONS:
        measured_above = [precision for precision in measured if precision >= target_precision]
        threshold = measured[min(measured_above)] if measured_above else ACCEPT_NOTHING
        thresholds.append(threshold)
    return tuple(thresholds)


def never_above_lower(thresholds: Sequence[float]) -> tuple[float, ...]:
    """Thresholds of ascending target precisions, none of them above that of a lower one."""
    return tuple(np.minimum.accumulate(thresholds).tolist())


def tested(
    usual_thresholds: ClaimThresholds,
    judge: Judge,
    evidence: FixEvidence[FixT_co],
    unseen_share: float,
) -> ClaimThresholds:
    """The usual thresholds of all maps, tested on the evidence of one of them.

    Each threshold is the usual one, or a lower one if the usual one misses the target precision on
    the evidence.
    """
    error_probabilities, is_true = evidence.judged(judge)
    weight = evidence.weight(unseen_share)
    thresholds = {}
    for claim, of_claim, is_true_of_claim in zip(
        CLAIMS, error_probabilities.T, is_true.T, strict=True
    ):
        thresholds_of_claim = []
        for target_precision, usual_threshold in zip(
            TARGET_PRECISIONS, usual_thresholds[claim], strict=True
        ):
            accepted = of_claim < usual_threshold
            wrong = float(weight[accepted & ~is_true_of_claim].sum())
            is_reached = wrong <= (1 - target_precision) * float(weight[accepted].sum())
            lower = threshold_for(
                target_precision,
                of_claim[accepted],
                is_true_of_claim[accepted],
                weight[accepted],
            )
            thresholds_of_claim.append(usual_threshold if is_reached else lower)
        thresholds[claim] = never_above_lower(thresholds_of_claim)
    return thresholds


def middle(error_probabilities: NDArray[np.float64], threshold: float) -> float:
    """Move a threshold to the middle, in log-odds, of its gap between error probabilities (n,).

    A threshold below or above all error probabilities is returned unchanged.
    """
    above = error_probabilities[error_probabilities >= threshold]
    below = error_probabilities[error_probabilities < threshold]
    if not len(above) or not len(below):
        return threshold
    lower, upper = np.array([below.max(), above.min()]).clip(
        LEAST_ERROR_PROBABILITY, 1 - LEAST_ERROR_PROBABILITY
    )
    return float(expit((logit(lower) + logit(upper)) / 2))


def _reported(fix: AnyFix) -> list[int]:
    """The indices of the SEVERAL reported hypotheses: the likeliest, and runners-up elsewhere."""
    return [0, *fix.elsewhere[: SEVERAL - 1]]
