"""Expectations: the features that right fixes have, place by place (METHODS 9.5).

A feature is a number that is evidence for a pose, such as its overlap with the map
(`probabilities.FEATURES`). Among houses a right pose overlaps more with the map, and its position
is more certain, than on an open field. So before a pose is judged, its features are lowered by the
amount by which right fixes near it, on the training day, exceed that day's medians.

A margin over perceptual aliases is not lowered: where a street repeats itself a small margin is
expected, and yet it is no evidence for a pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.probabilities import FEATURES

AROUND_M = 15.0
"""The features of right fixes nearer to a pose than this are expected at the pose."""
FEWEST = 3
"""If fewer right fixes are within AROUND_M, the day's median features are expected."""
IS_COMPARED = np.array([name in ("margin", "ahead") for name in FEATURES])
"""(feature,) the features that compare a pose with others; they have no expectation."""
POSITIONS = "expected_xy_m"
"""The name of the array `xy_m` in a site file."""
FEATURE_ROWS = "expected_features"
"""The name of the array `features` in a site file."""


@dataclass(frozen=True)
class Expectations:
    """The positions and features of the right fixes on the validation blocks of training."""

    xy_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(fix, 2) positions in the world's frame."""
    features: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, len(FEATURES))))
    """(fix, feature) features in the order of probabilities.FEATURES."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The expectations in the arrays of a site file.

        Raises KeyError for a missing array, and ValueError for shapes that do not fit together or
        a number that is not finite.
        """
        xy_m = arrays[POSITIONS]
        features = arrays[FEATURE_ROWS]
        fits = xy_m.shape == (len(features), 2) and features.shape == (len(features), len(FEATURES))
        if not fits or not (np.isfinite(xy_m).all() and np.isfinite(features).all()):
            raise ValueError(f"{POSITIONS} {xy_m.shape}, {FEATURE_ROWS} {features.shape}")
        return cls(xy_m, features)

    @property
    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """The arrays that a site file keeps."""
        return {POSITIONS: self.xy_m, FEATURE_ROWS: self.features}

    def excess(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the features (feature,) of right fixes around a position (2,) exceed the day's.

        It is the difference of the two medians; 0 if fewer than FEWEST fixes lie within AROUND_M,
        and 0 for features that compare a pose with others.
        """
        is_around = np.linalg.norm(self.xy_m - xy_m, axis=1) < AROUND_M
        if is_around.sum() < FEWEST:
            return np.zeros(len(FEATURES))
        excess = np.median(self.features[is_around], axis=0) - self._usual
        return np.where(IS_COMPARED, 0.0, excess)

    @cached_property
    def _usual(self) -> NDArray[np.float64]:
        """The median of each feature (feature,) over all right fixes of the day."""
        return np.asarray(np.median(self.features, axis=0))
