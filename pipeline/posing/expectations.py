"""Expectations: the signs that right fixes have, place by place (METHODS 9.5).

Among houses a right pose overlaps more, and is held better, than on an open field or in a wide
square. So a sign counts by how far it lies from what right fixes around it had on the training day.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.chances import SIGNS

AROUND_M = 15.0
"""Right fixes so near to a pose tell what is to be expected there."""
FEWEST = 3
"""Where fewer are so near, the usual signs of the day are expected."""
POSITIONS = "expected_xy_m"
"""The name of `xy_m` in a site file."""
SIGN_ROWS = "expected_signs"
"""The name of `signs` in a site file."""


@dataclass(frozen=True)
class Expectations:
    """The signs of right held-out fixes, and where these lie; without any, nothing is expected."""

    xy_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(fix, 2) in the world's frame."""
    signs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, len(SIGNS))))
    """(fix, sign) in the order of chances.SIGNS."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Those of a site file's arrays.

        Raises KeyError where it lacks one, ValueError where they do not fit together or hold a
        number that is not finite.
        """
        xy_m = arrays[POSITIONS]
        signs = arrays[SIGN_ROWS]
        fits = xy_m.shape == (len(signs), 2) and signs.shape == (len(signs), len(SIGNS))
        if not fits or not (np.isfinite(xy_m).all() and np.isfinite(signs).all()):
            raise ValueError(f"{POSITIONS} {xy_m.shape}, {SIGN_ROWS} {signs.shape}")
        return cls(xy_m, signs)

    @property
    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """The arrays that a site file keeps."""
        return {POSITIONS: self.xy_m, SIGN_ROWS: self.signs}

    def excess(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much the signs (sign,) of right fixes around a position (2,) exceed the usual.

        Medians are compared. 0 where fewer than FEWEST lie within AROUND_M.
        """
        is_around = np.linalg.norm(self.xy_m - xy_m, axis=1) < AROUND_M
        if is_around.sum() < FEWEST:
            return np.zeros(len(SIGNS))
        return np.asarray(np.median(self.signs[is_around], axis=0) - self._usual)

    @cached_property
    def _usual(self) -> NDArray[np.float64]:
        """The medians (sign,) of the day."""
        return np.asarray(np.median(self.signs, axis=0))
