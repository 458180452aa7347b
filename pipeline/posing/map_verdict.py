"""The verdict on fixes in a 3-D map that nobody drove for us (METHODS 15).

Without a drive in the map, probabilities and thresholds are the usual ones. Scans drawn from the
map itself teach nothing: they fit it far better than a real scan some months later. `calibrated`
learns from the fixes of a real drive.
"""

from dataclasses import replace

from pipeline.posing import covariances
from pipeline.posing.fix import ScanFix
from pipeline.posing.later_day import taught_or_tested
from pipeline.posing.learned_verdict import Learned
from pipeline.posing.probabilities import OF_MAPS
from pipeline.posing.search import Fixer
from pipeline.posing.verdict import (
    CLAIMS,
    TARGET_PRECISIONS,
    ClaimThresholds,
    FixEvidence,
    Judge,
    Verdict,
    never_above_lower,
    usual_thresholds,
)

WALLS_M = 50.0
"""A query's walls up to this distance are compared with the map's."""
ROUNDS = (5,)
"""One round of further answers: the search from above has ranked them by the whole map, so the
first is nearly always right, and a second round of cut-outs only takes time."""
USUAL = Judge(OF_MAPS, OF_MAPS)
"""The judge of fixes in a map in which nobody has driven yet."""
UNSEEN_SHARE = 0.2
"""The expected share of queries from places that the map does not have."""
USUAL_THRESHOLDS: ClaimThresholds = dict.fromkeys(
    CLAIMS, usual_thresholds({0.95: 0.05, 0.99: 0.01})
)
"""For each of CLAIMS and of TARGET_PRECISIONS, the error probability from which on the claim is
rejected: one minus the target precision, measured at .95 and .99. Probabilities learned elsewhere
say nothing of more than .99."""
NOT_CALIBRATED = "not calibrated on this map"


def usual_verdict() -> Verdict:
    """The verdict of a map in which nobody has driven yet."""
    usual = tuple(
        target_precision
        for target_precision, threshold in zip(
            TARGET_PRECISIONS, USUAL_THRESHOLDS["fix"], strict=True
        )
        if threshold > 0
    )
    return Verdict(
        USUAL.pose,
        USUAL.place,
        TARGET_PRECISIONS,
        USUAL_THRESHOLDS,
        0,
        UNSEEN_SHARE,
        usual,
        covariances.USUAL,
    )


def usual(fixer: Fixer) -> tuple[Learned, Fixer]:
    """What is known without validation blocks, and the search with the settings of maps."""
    learned = Learned(usual_verdict(), fix_count=0)
    walls = replace(fixer.walls, range_m=WALLS_M)
    return learned, replace(learned.tuned(fixer), walls=walls, rounds=ROUNDS)


def calibrated(evidence: FixEvidence[ScanFix]) -> Verdict:
    """The verdict that the fixes of a drive teach.

    The probabilities are learned, starting from the usual ones. The thresholds of a target
    precision are learned if the validation blocks are enough; otherwise they are the usual ones,
    lowered where the drive contradicts them.
    """
    verdict = evidence.verdict(UNSEEN_SHARE, USUAL)
    judge = replace(USUAL, pose=verdict.pose, place=verdict.place)
    mixed, learned = taught_or_tested(USUAL_THRESHOLDS, judge, evidence, UNSEEN_SHARE)
    thresholds = {claim: never_above_lower(mixed[claim]) for claim in CLAIMS}
    usual = tuple(
        target_precision
        for target_precision, threshold in zip(TARGET_PRECISIONS, thresholds["fix"], strict=True)
        if target_precision not in learned and threshold > 0
    )
    return replace(verdict, claim_thresholds=thresholds, usual=usual)
