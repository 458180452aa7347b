"""Verdicts: the chance that a fix is right, and where a promise is kept; from held-out blocks (METHODS 9.5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from pipeline.frames import Poses, apart
from pipeline.matching.rejection import threshold_for
from pipeline.posing.fix import Fix

PROMISES = (0.95, 0.99, 0.999)
"""Wanted precisions: shares of right fixes among the accepted ones."""
RIGHT_M, RIGHT_DEG = 2.0, 5.0
"""A fix is right within these: the field's measure."""
LEAST_SPREAD_M = 1e-4


@dataclass(frozen=True)
class Evidence:
    """Fixes of h held-out queries, the first time with the whole map and then, in the same order, without their surroundings."""

    features: NDArray[np.float64]
    """(2 h, feature)."""
    right: NDArray[np.bool_]
    """(2 h,)."""

    @property
    def queries(self) -> int:
        """h."""
        return len(self.right) // 2


@dataclass(frozen=True)
class Verdict:
    """Tells the chance that a fix is right: a logistic regression on what speaks for it."""

    evidence: Evidence
    unseen_share: float
    """Share of queries to expect from places that the map does not have."""

    @property
    def weight(self) -> NDArray[np.float64]:
        """(2 h,) how many of h real queries each of the evidence stands for."""
        return np.repeat([1 - self.unseen_share, self.unseen_share], self.evidence.queries)

    @cached_property
    def _model(self) -> Any:
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        model = make_pipeline(StandardScaler(), LogisticRegression())
        return model.fit(self.evidence.features, self.evidence.right, logisticregression__sample_weight=self.weight)

    @property
    def chances(self) -> "Chances":
        """The same chance as numbers that a file can hold."""
        outcomes = np.unique(self.evidence.right)
        if len(outcomes) < 2:
            return Chances((0.0,) * 3, SURE if outcomes.any() else -SURE)
        scaler, regression = self._model[0], self._model[-1]
        weights = regression.coef_[0] / scaler.scale_
        return Chances(tuple(map(float, weights)), float(regression.intercept_[0] - weights @ scaler.mean_))

    def chance(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """That each fix (q,) is right, given its features (q, feature); 0 without a pose.

        Where all held-out fixes had one outcome, that is all that it tells.
        """
        outcomes = np.unique(self.evidence.right)
        if len(outcomes) < 2:
            return np.where(features[:, 0] > 0, float(outcomes.any()), 0.0)
        return np.where(features[:, 0] > 0, self._model.predict_proba(features)[:, 1], 0.0)

    def threshold(self, novelty: NDArray[np.float64], promise: float) -> float:
        """The novelty to reject from, given that of the evidence (2 h,), to keep a promise; it accepts nothing where none does.

        It is kept even if one more of the accepted had been wrong: a promise of .99 takes 99 accepted queries. So conformal
        prediction bounds the risk of a further query (Angelopoulos et al., Conformal Risk Control, ICLR 2024).
        """
        rounded = novelty.astype(np.float32).astype(np.float64)
        return threshold_for(promise, rounded, self.evidence.right, self.weight, wrong_besides=1.0)


SURE = 40.0
"""Log-odds of a chance that float64 rounds to 1, and −SURE to 0 beside 1; a file of JSON holds no infinity."""


@dataclass(frozen=True)
class Chances:
    """The chance that a fix is right, from its features."""

    weights: tuple[float, ...]
    """(feature,)."""
    offset: float

    def of(self, fixes: Sequence[Fix]) -> NDArray[np.float64]:
        """(q,) of q fixes; 0 without a pose."""
        known = features(fixes)
        return np.where(known[:, 0] > 0, expit(known @ np.array(self.weights) + self.offset), 0.0)


def features(fixes: Sequence[Fix]) -> NDArray[np.float64]:
    """What speaks for each of q fixes (q, 3): overlap, structure, and log₁₀ of the spread in metres; 0 without a pose."""
    found = np.zeros((len(fixes), 3))
    for row, fix in zip(found, fixes, strict=True):
        for best in fix.hypotheses[:1]:
            row[:] = best.alignment.overlap, best.structure, np.log10(max(best.alignment.spread_m, LEAST_SPREAD_M))
    return found


def right(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.bool_]:
    """Which fixes (n, 4, 4) are right; a missing one is not."""
    away_m, turn_deg = apart(world_T_query, world_T_true)
    return (away_m < RIGHT_M) & (turn_deg < RIGHT_DEG)
