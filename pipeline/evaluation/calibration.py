"""Calibration: do confidences mean what they say? Of answers given with 80 %, are 80 % right?

In: the confidence in each answer and whether it is right. Out: a reliability diagram, or the
expected calibration error as one number.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

BINS = 10
"""Number of bins, equally wide, into which confidences are sorted."""
ROUNDING = 1e-6
"""A probability may exceed 1 or fall below 0 by this much."""


@dataclass(frozen=True)
class Reliability:
    """Answers in bins of equal width of their confidence."""

    confidence: NDArray[np.float64]
    """(bin,) mean confidence of the answers; NaN in an empty bin."""
    right: NDArray[np.float64]
    """(bin,) share of the answers that is right; NaN in an empty bin."""
    count: NDArray[np.int64]
    """(bin,) number of answers."""


def reliability(confidence: NDArray[Any], right: NDArray[np.bool_]) -> Reliability:
    """Bin answers by confidence (q,), a probability; `right` (q,) says which answers are right.

    Raises InputError for a confidence that is not between 0 and 1.
    """
    if not probabilities(confidence):
        raise InputError("expected each confidence to be a probability between 0 and 1")
    confidence = np.asarray(confidence, np.float64)
    bin_of = (confidence * BINS).astype(np.int64).clip(0, BINS - 1)
    count = np.bincount(bin_of, minlength=BINS)
    count_or_nan = np.where(count > 0, count, np.nan)
    mean_confidence = np.bincount(bin_of, confidence, BINS) / count_or_nan
    right_share = np.bincount(bin_of, right, BINS) / count_or_nan
    return Reliability(mean_confidence, right_share, count)


def ece(confidence: NDArray[Any], right: NDArray[np.bool_]) -> float:
    """Expected calibration error: the mean over the answers of the gap of their bin.

    A bin's gap is between its mean confidence and its share of right answers. NaN without answers,
    and if a confidence is not between 0 and 1, such as a descriptor's distance.
    """
    if len(confidence) == 0 or not probabilities(confidence):
        return np.nan
    bins = reliability(confidence, right)
    return float(np.nansum(np.abs(bins.confidence - bins.right) * bins.count) / bins.count.sum())


def probabilities(confidence: NDArray[Any]) -> bool:
    """Whether all confidences lie between 0 and 1, up to rounding."""
    return bool(((confidence >= -ROUNDING) & (confidence <= 1 + ROUNDING)).all())
