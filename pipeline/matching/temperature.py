"""Temperature scaling: one number that makes a network's probabilities mean what they say (Guo et al., ICML 2017)."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

LOG_RANGE = (-3.0, 3.0)


def temperature(logits: NDArray[np.float64], classes: NDArray[np.int64]) -> float:
    """What to divide logits (n, classes) by, so that the likelihood of the true `classes` (n,) is highest; 1 for no rows."""
    if not len(classes):
        return 1.0

    def surprise(log_t: float) -> float:
        return float(-log_softmax(logits / np.exp(log_t), axis=1)[np.arange(len(classes)), classes].mean())

    return float(np.exp(minimize_scalar(surprise, bounds=LOG_RANGE, method="bounded").x))
