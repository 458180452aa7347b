"""How well a model does on validation blocks of its training sequence, as one number.

In: the model's evidence, that is its answers to queries from stretches of the training path that it
did not learn. Out: the area under their precision-recall curve. Settings may be chosen by this
number, and never by the test sequences.
"""

import numpy as np

from pipeline.evaluation.numbers import auc_exact
from pipeline.evaluation.protocols import GroundTruth
from pipeline.matching.rejection import NoveltyEvidence


def validation_auc(evidence: NoveltyEvidence, kind: str, unseen_share: float) -> float:
    """Area under the exact precision-recall curve of the first answers to validation queries.

    It is by cells, with the SCI authors' rule of recall (`curves`). Each validation query counts
    once as seen and once as unseen: then its surroundings are taken from what the model learned.
    `kind` is the kind of novelty, `unseen_share` the share of unseen queries that is assumed.
    """
    # Two rows for each query: first those as seen queries, then those as unseen ones.
    novelty, right, weight = evidence.queries(kind, unseen_share)
    seen = np.arange(len(novelty)) < len(evidence.right)
    ground_truth = GroundTruth(
        seen=seen, unseen=~seen, true_rank=np.where(right, 0, -1), oracle_right=right
    )
    return float(auc_exact(ground_truth, novelty.astype(np.float32), weight[None])[0])
