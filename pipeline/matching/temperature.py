"""Temperature scaling (Guo et al., ICML 2017): logits and true classes in, the temperature out.

Divided by this temperature, the logits give calibrated probabilities: of the answers with
probability p, a share p is right.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

LOG_BOUNDS = (-3.0, 3.0)
"""Natural logarithms of the lowest and the highest temperature searched: 0.05 and 20."""
TOLERANCE = 1e-6
"""A minimum must lie at least this far below the losses at both ends of the range, in nats."""


def fit_temperature(logits: NDArray[np.float64], classes: NDArray[np.int64]) -> float:
    """The temperature at which logits (n, k) make the true `classes` (n,) most likely.

    Only temperatures within LOG_BOUNDS are searched. It is 1 if n is 0.
    """
    if not len(classes):
        return 1.0

    def loss(log_t: float) -> float:
        return _loss(logits, classes, log_t)

    minimum = minimize_scalar(loss, bounds=LOG_BOUNDS, method="bounded")
    return float(np.exp(minimum.x))


def determines_temperature(
    temperature: float, logits: NDArray[np.float64], classes: NDArray[np.int64]
) -> bool:
    """Whether the data determine the temperature that `fit_temperature` found for them.

    They do if its loss is below the losses at both ends of LOG_BOUNDS. They do not if there are no
    rows, or if all rows are right, since then the lowest temperature is the best.
    """
    if not len(classes):
        return False
    loss = _loss(logits, classes, np.log(temperature))
    loss_at_ends = min(_loss(logits, classes, bound) for bound in LOG_BOUNDS)
    return loss < loss_at_ends - TOLERANCE


def _loss(logits: NDArray[np.float64], classes: NDArray[np.int64], log_t: float) -> float:
    """Mean negative log-likelihood of the true classes, in nats, at the temperature exp(log_t)."""
    log_probability = log_softmax(logits / np.exp(log_t), axis=1)
    return float(-log_probability[np.arange(len(classes)), classes].mean())
