"""Kinds of novelty of a network that takes places for classes (METHODS 2.6)."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import entr, logsumexp, softmax


def novelties(
    logits: NDArray[np.float64], softness: float, likeness: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Kinds of novelty (n,) of logits (n, places) at a temperature.

    `likeness` (n,) is the cosine to the likest training view. The paper's entropy comes first; the
    second is it at the held-out blocks' temperature; energy is Liu et al.'s, NeurIPS 2020.
    """
    return {
        "entropy": normalised_entropy(softmax(logits, axis=1)),
        "tempered_entropy": normalised_entropy(softmax(logits / softness, axis=1)),
        "energy": -np.asarray(logsumexp(logits, axis=1)),
        "feature_distance": 1 - likeness.astype(np.float64),
    }


def normalised_entropy(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Entropy (n,) of probabilities (n, places) over log₂ places (METHODS 2.6).

    0 for one sure place, 1 for none.
    """
    normalised: NDArray[np.float64] = entr(probability).sum(axis=1) / np.log(
        max(probability.shape[1], 2)
    )
    return normalised
