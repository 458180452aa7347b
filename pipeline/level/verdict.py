"""The verdict on level fixes: that of any map, and its thresholds tested on the map's own
stretches.

One building has too few stretches of path to learn from. So probabilities and thresholds come from
three recorded buildings, and a map's own evidence can only lower the thresholds (METHODS 13.4).
"""

from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.level.fix import SCALES, LevelFix
from pipeline.matching.rejection import ACCEPT_NOTHING, threshold_for
from pipeline.posing.probabilities import Probabilities
from pipeline.posing.verdict import (
    CLAIMS,
    TARGET_PRECISIONS,
    ClaimThresholds,
    FixEvidence,
    Judge,
    Tolerances,
    Verdict,
)

OF_SWEEPS = Tolerances(
    LEVEL_RIGHT_WITHIN, near_m=5.0, largest_multiple=5.0, scales=SCALES, is_level=True
)
"""The tolerances of level sweeps."""
USUAL = Judge(
    Probabilities((9.01, 0.0, 8.64, 6.94, 23.67), -17.57),
    Probabilities((8.93, 0.0, 8.63, 6.96, 23.39), -17.52),
    OF_SWEEPS,
)
"""The judge of any map: learned from validation stretches of the first halves of three recorded
buildings (`python -m benchmarks.level CARMEN --usual`)."""
USUAL_THRESHOLDS: ClaimThresholds = {
    "fix": (0.25, 0.05, ACCEPT_NOTHING),
    "place": (0.25, 0.05, ACCEPT_NOTHING),
    "several": (0.25, ACCEPT_NOTHING, ACCEPT_NOTHING),
}
"""For each of CLAIMS the error probabilities from which on to reject it, one for each of
TARGET_PRECISIONS, by the same stretches."""
LARGEST_ERROR_PROBABILITY = max(max(thresholds) for thresholds in USUAL_THRESHOLDS.values())
"""No claim with this error probability or a larger one is accepted in any map."""
NO_EVIDENCE = FixEvidence[LevelFix].joined([])
"""That of a map without sweeps to hold out."""


def verdict_of(evidence: FixEvidence[LevelFix], unseen_share: float) -> Verdict:
    """The usual verdict, tested on a map's own evidence.

    A threshold is the usual one, or a lower one where that misses the target precision on the
    evidence.
    """
    all_error_probabilities, all_true = evidence.judged(USUAL)
    weight = evidence.weight(unseen_share)
    thresholds = {}
    for claim, error_probabilities, true in zip(
        CLAIMS, all_error_probabilities.T, all_true.T, strict=True
    ):
        thresholds_of_claim = []
        for target_precision, usual_threshold in zip(
            TARGET_PRECISIONS, USUAL_THRESHOLDS[claim], strict=True
        ):
            accepted = error_probabilities < usual_threshold
            wrong = float(weight[accepted & ~true].sum())
            is_kept = wrong <= (1 - target_precision) * float(weight[accepted].sum())
            lower = threshold_for(
                target_precision, error_probabilities[accepted], true[accepted], weight[accepted]
            )
            thresholds_of_claim.append(usual_threshold if is_kept else lower)
        thresholds[claim] = tuple(thresholds_of_claim)
    return Verdict(
        USUAL.pose, USUAL.place, TARGET_PRECISIONS, thresholds, evidence.blocks, unseen_share
    )
