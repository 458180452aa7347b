"""How a model did on held-out blocks of its training sequence: its evidence in; an area out.

Settings may be chosen by this number, and never by the test sequences.
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
    evidence: Evidence, kind: str, unseen_share: float, counts: NDArray[np.float64]
) -> Number:
    """The same area (r,) in r resamples, in which each held-out query counts `counts` (r, h) times.

    `kind` is the kind of novelty, `unseen_share` the share of unseen queries that is assumed.
    """
    novelty, right, weight = evidence.queries(kind, unseen_share)  # first the seen, then the unseen
    seen = np.arange(len(novelty)) < len(evidence.right)
    truth = Truth(seen, ~seen, np.where(right, 0, -1), right)
    return auc_exact(truth, novelty.astype(np.float32), weight * np.tile(counts, 2))
