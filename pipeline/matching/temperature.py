"""Temperature scaling: calibrates a network's probabilities by one number.

Guo et al., ICML 2017.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

LOG_RANGE = (-3.0, 3.0)
"""Natural logarithms of the temperatures searched: e⁻³ = 0.05 to e³ = 20."""
TOLERANCE = 1e-6
"""Nats by which a minimum must lie below the ends of the range."""


def temperature(logits: NDArray[np.float64], classes: NDArray[np.int64]) -> float:
    """The temperature at which logits (n, classes) give the true `classes` (n,) most likelihood.

    1 for no rows.
    """
    if not len(classes):
        return 1.0
    minimum = minimize_scalar(
        lambda log_t: _loss(logits, classes, log_t), bounds=LOG_RANGE, method="bounded"
    )
    return float(np.exp(minimum.x))


def determined(softness: float, logits: NDArray[np.float64], classes: NDArray[np.int64]) -> bool:
    """Whether the likelihood is higher at this temperature than at both ends of the range.

    It is not where all rows are right, for then the colder the likelier, nor where there are none.
    """
    if not len(classes):
        return False
    return (
        _loss(logits, classes, np.log(softness))
        < min(_loss(logits, classes, bound) for bound in LOG_RANGE) - TOLERANCE
    )


def _loss(logits: NDArray[np.float64], classes: NDArray[np.int64], log_t: float) -> float:
    """Mean negative log-likelihood, in nats."""
    return float(
        -log_softmax(logits / np.exp(log_t), axis=1)[np.arange(len(classes)), classes].mean()
    )
