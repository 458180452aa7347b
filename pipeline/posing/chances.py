"""Chances: how likely each hypothesis of a query is right, by the signs for it (METHODS 9.5).

Of a query's hypotheses at most one is right. So their chances are shares: exp(s) / (1 + Σ exp(s)),
with a score s for each, linear in its signs, and the 1 for "none of them" (McFadden's conditional
logit). A look-alike takes from the others' chances.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SIGNS = ("overlap", "seen_again", "surety", "upright", "lead", "ahead")
"""What speaks for a hypothesis; more of each is never worse.

The first two are the means of the Agreements with its own submap and with another beside it; surety
is −log₁₀ of the spread in metres, upright −1 for 10° of tilt against the submap or more, lead that
of its slide, ahead how much higher its quality is than that of the query's best other hypothesis,
negative of one that is behind; 0 where there is no other.
"""
SCALES = np.array([0.12, 0.25, 0.2, 0.15, 0.12, 0.15])
"""A usual difference of each sign: weights are learned as if the signs were divided by these."""
STIFFNESS = 0.5
"""Weights, so scaled, stray from their start by this standard deviation."""


@dataclass(frozen=True)
class Chances:
    """A model of the chance that each hypothesis of a query is right, linear in its signs."""

    weights: tuple[float, ...]
    """(sign,), none below 0."""
    offset: float

    def scores(self, signs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The score (n,) of each hypothesis of one query, from its signs (n, sign).

        A score is the log-odds against none of them being right.
        """
        return np.asarray(signs @ np.array(self.weights) + self.offset)

    def shares(self, signs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The chance (n + 1,) of each hypothesis of one query, and last, that none is right."""
        scores = np.append(self.scores(signs), 0.0)
        return np.asarray(np.exp(scores - np.logaddexp.reduce(scores)))

    def of(self, signs: NDArray[np.float64]) -> NDArray[np.float64]:
        """The chance (n,) of each hypothesis of one query."""
        return self.shares(signs)[:-1]


USUAL = Chances((9.9, 6.9, 7.9, 5.0, 13.9, 7.5), -21.8)
"""What a site starts from; its own evidence moves it.

Learned from later days of two simulated campuses, seeds 2 and 5 (`python -m benchmarks.usual`).
"""


def learned(
    signs: Sequence[NDArray[np.float64]],
    right: Sequence[NDArray[np.bool_]],
    weight: NDArray[np.float64],
    start: Chances = USUAL,
    scales: NDArray[np.float64] = SCALES,
) -> Chances:
    """Learn chances from q queries.

    They are given by the signs (n, sign) of each one's hypotheses, which of these (n,) are right,
    and its weight (q,). The weights are the likeliest, given that they stray little from those of
    `start`, as if signs were divided by their `scales` (sign,); without any query they are those of
    `start`.
    """
    from scipy.optimize import minimize  # a robot does not learn

    queries = len(signs)
    most_hypotheses = max(map(len, signs), default=0)
    if not most_hypotheses:
        return start
    scaled = np.zeros((queries, most_hypotheses, len(scales)))
    present = np.zeros((queries, most_hypotheses), bool)
    good = np.zeros((queries, most_hypotheses), bool)
    for row, (query_signs, query_right) in enumerate(zip(signs, right, strict=True)):
        hypotheses = slice(len(query_signs))
        scaled[row, hypotheses] = query_signs / scales
        present[row, hypotheses] = True
        good[row, hypotheses] = query_right
    first = np.append(np.array(start.weights) * scales, start.offset)
    any_good = good.any(axis=1)

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The loss of scaled weights and the offset (sign + 1,), with its gradient."""
        scores = np.where(present, scaled @ weights[:-1] + weights[-1], -np.inf)
        whole = np.logaddexp.reduce(np.column_stack([np.zeros(queries), scores]), axis=1)
        chances = np.exp(scores - whole[:, None])
        of_good = np.where(good, chances, 0.0)
        total = np.maximum(of_good.sum(axis=1), 1e-300)
        likelihood = np.where(any_good, np.log(total), -whole)
        target_shares = of_good / total[:, None]
        slope = weight[:, None] * (chances - target_shares)
        strayed = (weights - first)[:-1] / STIFFNESS**2
        gradient = np.append(np.einsum("qn,qns->s", slope, scaled) + strayed, slope.sum())
        return float(-weight @ likelihood + strayed @ (weights - first)[:-1] / 2), gradient

    bounds = [(0.0, None)] * len(scales) + [(None, None)]
    best = minimize(loss, first, jac=True, bounds=bounds, method="L-BFGS-B").x
    return Chances(tuple(map(float, best[:-1] / scales)), float(best[-1]))
