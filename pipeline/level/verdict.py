"""The verdict on level fixes: the same for all maps, tested on each map's own sweeps.

One building has too few stretches of path to learn from. So the models of probabilities and the
thresholds come from three recorded buildings, and a map's own evidence can only lower the
thresholds (METHODS 13.4).
"""

from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.level.fix import SCALES, LevelFix
from pipeline.posing.probabilities import HypothesisModel
from pipeline.posing.verdict import (
    TARGET_PRECISIONS,
    ClaimThresholds,
    FixEvidence,
    Judge,
    Tolerances,
    Verdict,
    tested,
    usual_thresholds,
)

OF_SWEEPS = Tolerances(
    LEVEL_RIGHT_WITHIN, near_m=5.0, largest_multiple=5.0, scales=SCALES, is_level=True
)
"""The tolerances of level sweeps."""
USUAL = Judge(
    HypothesisModel((9.01, 0.0, 8.64, 6.94, 23.67), -17.57),
    HypothesisModel((8.93, 0.0, 8.63, 6.96, 23.39), -17.52),
    OF_SWEEPS,
)
"""The judge of all maps, learned from validation stretches of the first halves of three recorded
buildings (`python -m benchmarks.level CARMEN --usual`)."""
USUAL_THRESHOLDS: ClaimThresholds = {
    "fix": usual_thresholds({0.95: 0.25, 0.99: 0.05}),
    "place": usual_thresholds({0.95: 0.25, 0.99: 0.05}),
    "several": usual_thresholds({0.95: 0.25}),
}
"""For each of CLAIMS and of TARGET_PRECISIONS, the error probability from which on the claim is
rejected; learned at .95 and .99 from the same stretches."""
LARGEST_ERROR_PROBABILITY = max(max(thresholds) for thresholds in USUAL_THRESHOLDS.values())
"""No claim with this error probability or a larger one is accepted in any map."""
NO_EVIDENCE = FixEvidence[LevelFix].joined([])
"""The evidence of a map without sweeps for validation."""


def verdict_of(evidence: FixEvidence[LevelFix], unseen_share: float) -> Verdict:
    """The usual verdict, tested on a map's own evidence.

    Each threshold is the usual one, or a lower one if the usual one misses the target precision on
    the evidence.
    """
    thresholds = tested(USUAL_THRESHOLDS, USUAL, evidence, unseen_share)
    return Verdict(
        USUAL.pose, USUAL.place, TARGET_PRECISIONS, thresholds, evidence.blocks, unseen_share
    )
