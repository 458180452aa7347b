"""Kinds of novelty of a network that classifies places: its outputs in, how new each query is out.

All kinds increase with the probability that the query's place was never seen (METHODS 2.6).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import entr, logsumexp, softmax


def novelties(
    logits: NDArray[np.float64], temperature: float, max_cosine: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return each kind of novelty (n,) of n queries by its name.

    `logits` (n, places) are the network's outputs, `temperature` is the one that calibrates them
    (`matching.temperature`), and `max_cosine` (n,) is the largest cosine between the query's
    feature and the features of the training views. `entropy` is the paper's, `tempered_entropy` is
    the entropy at that temperature, and `energy` is from Liu et al., NeurIPS 2020.
    """
    return {
        "entropy": normalised_entropy(softmax(logits, axis=1)),
        "tempered_entropy": normalised_entropy(softmax(logits / temperature, axis=1)),
        "energy": -np.asarray(logsumexp(logits, axis=1)),
        "feature_distance": 1 - max_cosine.astype(np.float64),
    }


def normalised_entropy(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Entropy (n,) of probabilities (n, places), divided by the entropy of equal probabilities.

    It is 0 if one place is certain, and 1 if all places are equally likely.
    """
    places = max(probability.shape[1], 2)
    return np.asarray(entr(probability).sum(axis=1) / np.log(places))
