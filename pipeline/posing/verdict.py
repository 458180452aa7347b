"""Verdicts: the chance that a fix is right, and where a promise is kept; from held-out blocks (METHODS 9.5)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, apart
from pipeline.matching.rejection import threshold_for

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
RIGHT_M, RIGHT_DEG = 2.0, 5.0
"""A fix is right within these: the field's measure."""


@dataclass(frozen=True)
class Evidence:
    """Fixes of h held-out queries, the first time with the whole map and then, in the same order, without their surroundings."""

    features: NDArray[np.float64]
    """(2 h, feature)."""
    right: NDArray[np.bool_]
    """(2 h,)."""
    queries: int
    """h."""

    def weight(self, unseen_share: float) -> NDArray[np.float64]:
        """(2 h,) how many real queries each stands for, when a share of them is to be expected unseen."""
        return np.repeat([1 - unseen_share, unseen_share], self.queries)


@dataclass(frozen=True)
class Verdict:
    """Tells the chance that a fix is right: a logistic regression on what speaks for it."""

    evidence: Evidence
    unseen_share: float

    @cached_property
    def _model(self) -> Any:
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        weight = self.evidence.weight(self.unseen_share)
        model = make_pipeline(StandardScaler(), LogisticRegression())
        return model.fit(self.evidence.features, self.evidence.right, logisticregression__sample_weight=weight)

    def chance(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """That each fix (q,) is right, given its features (q, feature); its overlap where the evidence knows one outcome only."""
        if self.evidence.right.all() or not self.evidence.right.any():
            return features[:, 0]
        return np.where(features[:, 0] > 0, self._model.predict_proba(features)[:, 1], 0.0)

    def thresholds(self, novelty: NDArray[np.float64], promises: tuple[float, ...] = PROMISES) -> list[float]:
        """The novelty (2 h,) of the evidence to reject from, for each promise."""
        weight = self.evidence.weight(self.unseen_share)
        rounded = novelty.astype(np.float32).astype(np.float64)
        return [threshold_for(promise, rounded, self.evidence.right, weight) for promise in promises]


def right(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
    """Which fixes (n, 4, 4) are right; a missing one is not."""
    away_m, turn_deg = apart(world_T_query, world_T_true)
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG)
