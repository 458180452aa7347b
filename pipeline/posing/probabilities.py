"""Probabilities: how likely each hypothesis of a query is right, by its features (METHODS 9.5).

In: the FEATURES of each hypothesis (a pose that the query may have). Out: the probability that the
hypothesis is right. At most one hypothesis of a query is right, so the probabilities come from
McFadden's conditional logit: exp(s) / (1 + Σ exp(s)), where s is a score linear in the features,
and the 1 stands for "none is right". So two poses that look equally good share the probability.
`learned` fits the weights of the features to queries whose true poses are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.prior import WRONG

FEATURES = ("overlap", "seen_again", "surety", "upright", "margin", "ahead")
"""The features of a hypothesis; a larger value never lowers its probability.

- overlap, seen_again: the shares of walls that the query and the map have in common (`Agreement`),
  each a mean over the submap that the query was registered against and another submap near it;
- surety: −log₁₀ of the spread of the position in metres;
- upright: 0 if the pose is not tilted against the submap, −1 if it is tilted by 10° or more;
- margin: how much better the walls fit at the pose than at its best perceptual alias (`Aliases`);
- ahead: the hypothesis's quality minus that of the query's best other hypothesis; 0 if there is no
  other.
"""
SCALES = np.array([0.12, 0.25, 0.2, 0.15, 0.12, 0.15])
"""A typical difference of each feature; weights are learned for features divided by these."""
PRIOR_SD = 0.5
"""Standard deviation of the normal prior on the weights of the scaled features, whose mean is the
weights that learning starts from."""


@dataclass(frozen=True)
class HypothesisModel:
    """A conditional logit: the probability that each hypothesis of a query is right."""

    weights: tuple[float, ...]
    """(feature,) the weight of each feature, none below 0."""
    offset: float
    """The score of a hypothesis whose features are all 0."""

    def scores(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """The score (n,) of each hypothesis of one query, from its features (n, feature).

        A score is the log-odds that this hypothesis is right against none being right.
        """
        return np.asarray(features @ np.array(self.weights) + self.offset)

    def probabilities_and_none(
        self, features: NDArray[np.float64], log_weights: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """The probabilities (n + 1,) that each hypothesis is right, and last that none is.

        `log_weights` (n,) are those of a prior, if there is one (posing/prior.py). What it left
        unsearched is added to "none is right".
        """
        scores = self.scores(features)
        none = 0.0
        if log_weights is not None:
            none = np.logaddexp(none, np.log(WRONG) + scores.max(initial=-np.inf))
            scores = scores + log_weights
        scores = np.append(scores, none)
        return np.asarray(np.exp(scores - np.logaddexp.reduce(scores)))

    def probabilities(
        self, features: NDArray[np.float64], log_weights: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """The probability (n,) of each hypothesis of one query, from its features (n, feature)."""
        return self.probabilities_and_none(features, log_weights)[:-1]


USUAL = HypothesisModel((6.2, 4.2, 7.0, 4.9, 16.7, 7.1), -15.4)
"""The model that the site of a drive starts from; `learned` adjusts it to the site's own evidence.

It was learned from the later days of two simulated campuses, seeds 2 and 5
(`python -m benchmarks.usual`).
"""
OF_MAPS = HypothesisModel((9.9, 6.9, 7.9, 5.0, 13.9, 7.5), -21.8)
"""The model that every site of a 3-D map starts from, whose margins are those near a pose only.

It was learned from the same days with such margins, by an earlier search.
"""


def learned(
    features: Sequence[NDArray[np.float64]],
    right: Sequence[NDArray[np.bool_]],
    weight: NDArray[np.float64],
    start: HypothesisModel = USUAL,
    scales: NDArray[np.float64] = SCALES,
) -> HypothesisModel:
    """Fit a model to q queries whose right hypotheses are known.

    For each query `features` holds the features (n, feature) of its n hypotheses, `right` which of
    them (n,) are right, and `weight` (q,) how often the query counts. The result is the maximum a
    posteriori model, with a normal prior around the weights of `start` (PRIOR_SD) for features
    divided by `scales` (feature,). Without any query it is `start`.
    """
    from scipy.optimize import minimize  # imported here, since a robot does not learn

    # Arrays of equal length for all queries, with room for the most hypotheses.
    query_count = len(features)
    most_hypotheses = max(map(len, features), default=0)
    if not most_hypotheses:
        return start
    scaled = np.zeros((query_count, most_hypotheses, len(scales)))
    is_present = np.zeros((query_count, most_hypotheses), bool)
    is_right = np.zeros((query_count, most_hypotheses), bool)
    for row, (query_features, query_right) in enumerate(zip(features, right, strict=True)):
        hypotheses = slice(len(query_features))
        scaled[row, hypotheses] = query_features / scales
        is_present[row, hypotheses] = True
        is_right[row, hypotheses] = query_right
    prior = np.append(np.array(start.weights) * scales, start.offset)
    has_right = is_right.any(axis=1)

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The loss of scaled weights and the offset (feature + 1,), with its gradient.

        It is −Σ weight · log(probability of the truth) + Σ (w − prior)² / (2 PRIOR_SD²). The truth
        is that one of the right hypotheses is right or, if a query has no right one, that none is.
        """
        scores = np.where(is_present, scaled @ weights[:-1] + weights[-1], -np.inf)
        log_sum = np.logaddexp.reduce(np.column_stack([np.zeros(query_count), scores]), axis=1)
        probabilities = np.exp(scores - log_sum[:, None])
        right_probabilities = np.where(is_right, probabilities, 0.0)
        total = np.maximum(right_probabilities.sum(axis=1), 1e-300)  # its logarithm stays finite
        log_likelihood = np.where(has_right, np.log(total), -log_sum)
        # The derivative (q, n) by each score: the hypothesis's probability, minus its share of the
        # probability of all right hypotheses.
        score_slopes = weight[:, None] * (probabilities - right_probabilities / total[:, None])
        pull = (weights - prior)[:-1] / PRIOR_SD**2  # the prior's derivative
        weight_slopes = np.einsum("qn,qns->s", score_slopes, scaled) + pull
        gradient = np.append(weight_slopes, score_slopes.sum())
        return float(-weight @ log_likelihood + pull @ (weights - prior)[:-1] / 2), gradient

    bounds = [(0.0, None)] * len(scales) + [(None, None)]
    best = minimize(loss, prior, jac=True, bounds=bounds, method="L-BFGS-B").x
    return HypothesisModel(tuple(map(float, best[:-1] / scales)), float(best[-1]))
