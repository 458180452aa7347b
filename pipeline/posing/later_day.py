"""Learns again when to accept a pose, from a later day with known poses (METHODS 9.5).

In: the thresholds that a site has, and the fixes of a day that the site did not learn. Out: new
thresholds. The models of the site's judge stay.

A target precision for which the day has enough blocks gets the threshold that the day teaches. The
others keep the site's own threshold, or get a lower one where the day contradicts it.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.posing import covariances
from pipeline.posing.fix import ScanFix
from pipeline.posing.verdict import (
    CLAIMS,
    TARGET_PRECISIONS,
    ClaimThresholds,
    FixEvidence,
    Judge,
    Verdict,
    tested,
    usual_thresholds,
)


@dataclass(frozen=True)
class Renewed:
    """The verdict of a site after a later day."""

    verdict: Verdict
    learned: tuple[float, ...]
    """The target precisions whose thresholds the day taught."""
    lowered: tuple[float, ...]
    """The target precisions whose own thresholds the day contradicted."""
    has_covariances: bool
    """Whether the day taught the model of covariances too."""


def renewed(verdict: Verdict, evidence: FixEvidence[ScanFix]) -> Renewed:
    """The verdict with the thresholds, and if it can the covariances, that a later day teaches.

    A threshold that keeps a target precision keeps each lower one too. So no threshold is below
    that of a higher target precision.
    """
    judge = Judge(verdict.pose, verdict.place)
    own = thresholds_of_all(verdict)
    mixed, learned = taught_or_tested(own, judge, evidence, verdict.unseen_share)
    thresholds = {
        claim: tuple(np.maximum.accumulate(mixed[claim][::-1])[::-1].tolist()) for claim in CLAIMS
    }
    lowered = tuple(
        target_precision
        for target_precision, before, after in zip(
            TARGET_PRECISIONS, own["fix"], thresholds["fix"], strict=True
        )
        if after < before and target_precision not in learned
    )
    before = verdict.covariances or covariances.USUAL
    after = evidence.covariance_model(judge, before)
    return Renewed(
        replace(
            verdict,
            target_precisions=TARGET_PRECISIONS,
            claim_thresholds=thresholds,
            covariances=after,
        ),
        learned,
        lowered,
        after is not before,
    )


def taught_or_tested(
    own: ClaimThresholds, judge: Judge, evidence: FixEvidence[ScanFix], unseen_share: float
) -> tuple[ClaimThresholds, tuple[float, ...]]:
    """The threshold of each target precision: what the evidence teaches, or its own one, tested.

    Returns them with the target precisions for which the blocks of the evidence suffice.
    """
    taught = evidence.thresholds(judge, unseen_share)
    tested_own = tested(own, judge, evidence, unseen_share)
    suffices = [threshold > 0 for threshold in taught["fix"]]
    thresholds = {
        claim: tuple(np.where(suffices, taught[claim], tested_own[claim]).tolist())
        for claim in CLAIMS
    }
    learned = tuple(np.array(TARGET_PRECISIONS)[suffices].tolist())
    return thresholds, learned


def thresholds_of_all(verdict: Verdict) -> ClaimThresholds:
    """A verdict's thresholds of TARGET_PRECISIONS; an earlier yearloc tried fewer of them."""
    return {
        claim: usual_thresholds(
            dict(zip(verdict.target_precisions, verdict.claim_thresholds[claim], strict=True))
        )
        for claim in CLAIMS
    }
