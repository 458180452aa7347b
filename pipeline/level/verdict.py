"""The verdict on level fixes: that of any map, and its limits tested on the map's own stretches.

One building has too few stretches of path to learn from. So chances and limits come from three
recorded buildings, and a map's own evidence can only lower the limits (METHODS 13.4).
"""

from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.level.fix import SCALES, LevelFix
from pipeline.matching.rejection import ACCEPT_NOTHING, threshold_for
from pipeline.posing.chances import Chances
from pipeline.posing.verdict import (
    BELIEFS,
    PROMISES,
    Beliefs,
    Evidence,
    Judge,
    Tolerances,
    Verdict,
)

OF_SWEEPS = Tolerances(
    LEVEL_RIGHT_WITHIN, near_m=5.0, largest_multiple=5.0, scales=SCALES, is_level=True
)
"""The tolerances of level sweeps."""
USUAL = Judge(
    Chances((9.01, 0.0, 8.64, 6.94, 23.67), -17.57),
    Chances((8.93, 0.0, 8.63, 6.96, 23.39), -17.52),
    OF_SWEEPS,
)
"""The judge of any map: learned from held-out stretches of the first halves of three recorded
buildings (`python -m benchmarks.level CARMEN --usual`)."""
USUAL_LIMITS: Beliefs = {
    "fix": (0.25, 0.05, ACCEPT_NOTHING),
    "place": (0.25, 0.05, ACCEPT_NOTHING),
    "several": (0.25, ACCEPT_NOTHING, ACCEPT_NOTHING),
}
"""For each of BELIEFS the doubts from which on to reject it, one for each of PROMISES, by the same
stretches."""
LARGEST_DOUBT = max(max(limits) for limits in USUAL_LIMITS.values())
"""No belief with this doubt or a larger one is accepted in any map."""
NO_EVIDENCE = Evidence[LevelFix].joined([])
"""That of a map without sweeps to hold out."""


def verdict_of(evidence: Evidence[LevelFix], unseen_share: float) -> Verdict:
    """The usual verdict, tested on a map's own evidence.

    A limit is the usual one, or a lower one where that breaks the promise on the evidence.
    """
    all_doubts, all_true = evidence.judged(USUAL)
    weight = evidence.weight(unseen_share)
    limits = {}
    for belief, doubts, true in zip(BELIEFS, all_doubts.T, all_true.T, strict=True):
        limits_of_belief = []
        for promise, usual_limit in zip(PROMISES, USUAL_LIMITS[belief], strict=True):
            accepted = doubts < usual_limit
            wrong = float(weight[accepted & ~true].sum())
            is_kept = wrong <= (1 - promise) * float(weight[accepted].sum())
            lower = threshold_for(promise, doubts[accepted], true[accepted], weight[accepted])
            limits_of_belief.append(usual_limit if is_kept else lower)
        limits[belief] = tuple(limits_of_belief)
    return Verdict(USUAL.pose, USUAL.place, PROMISES, limits, evidence.blocks, unseen_share)
