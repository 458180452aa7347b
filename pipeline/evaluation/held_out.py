"""How a model did on the held-out blocks of training.

Settings may be chosen by this, and never by the test sequences.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.numbers import Number, auc_exact
from pipeline.evaluation.protocols import Truth
from pipeline.matching.rejection import Evidence


def held_out_auc(evidence: Evidence, kind: str, unseen_share: float) -> float:
    """Area under the exact precision-recall curve on held-out queries, by cells, at top 1.

    By the authors' rules. Each held-out query counts once as seen and once, with its surroundings
    forgotten, as unseen.
    """
    return float(held_out_aucs(evidence, kind, unseen_share, np.ones((1, len(evidence.right))))[0])


def held_out_aucs(
    evidence: Evidence, kind: str, unseen_share: float, counted: NDArray[np.float64]
) -> Number:
    """The same area (r,) in r resamples, in which each held-out query is `counted` (r, h) times."""
    novelty, right, weight = evidence.queries(kind, unseen_share)
    seen = np.arange(len(novelty)) < len(evidence.right)
    truth = Truth(seen, ~seen, np.where(right, 0, -1), right)
    return auc_exact(truth, novelty.astype(np.float32), weight * np.tile(counted, 2))
