"""How a model did on the held-out blocks of training.

Settings may be chosen by this, and never by the test sequences.
"""

import numpy as np

from pipeline.evaluation.numbers import Queries, measures
from pipeline.evaluation.protocols import Truth
from pipeline.matching.rejection import Evidence


def held_out_auc(evidence: Evidence, kind: str, unseen_share: float) -> float:
    """Area under the exact precision-recall curve on held-out queries, by cells, at top 1.

    By the authors' rules. Each held-out query counts once as seen and once, with its surroundings
    forgotten, as unseen.
    """
    novelty, right, weight = evidence.queries(kind, unseen_share)
    seen = np.arange(len(novelty)) < len(evidence.right)
    truth = Truth(seen, ~seen, np.where(right, 0, -1), right)
    zeros = (np.zeros(len(novelty)),) * 2
    queries = Queries(
        novelty[:, None].astype(np.float32),
        (0.0,),
        np.zeros(1),
        *zeros,
        *zeros,
        *zeros,
        np.nan,
    )
    return float(measures(truth, queries, 0, weight[None])["auc_exact_top1"][0])
