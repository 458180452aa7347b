"""Random processes along a drive."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter


def wander(
    rng: np.random.Generator, steps: int, step_m: float, sd: float, correlation_m: float, clip: float
) -> NDArray[np.float64]:
    """A stationary Gauss–Markov process (steps,) of deviation `sd` and length `correlation_m`, clipped at ± `clip`."""
    keep = np.exp(-step_m / correlation_m)
    pushes = rng.normal(0, sd * np.sqrt(1 - keep**2), steps)
    pushes[0] = rng.normal(0, sd)
    return np.asarray(lfilter([1.0], [1.0, -keep], pushes)).clip(-clip, clip)


def smooth(values: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """`values` (n,) smoothed by a Hann window of `samples`; beyond the ends the first and last values are repeated."""
    window = np.hanning(samples + 2)[1:-1]
    held = np.concatenate([np.repeat(values[:1], samples), values, np.repeat(values[-1:], samples)])
    return np.convolve(held, window / window.sum(), "same")[samples:-samples]
