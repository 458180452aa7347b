"""Expectations: the signs that right fixes have, place by place (METHODS 9.5).

A sign is a number that speaks for a pose, such as its overlap with the map (`chances.SIGNS`). Among
houses a right pose overlaps more, and its position is more certain, than on an open field. So
before a pose is judged, its signs are lowered by as much as those of right fixes around it, on the
training day, exceed the usual.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.chances import SIGNS

AROUND_M = 15.0
"""Right fixes nearer to a pose than this say what to expect there."""
FEWEST = 3
"""If fewer right fixes are so near, the usual signs of the day are expected."""
POSITIONS = "expected_xy_m"
"""The name of `xy_m` in a site file."""
SIGN_ROWS = "expected_signs"
"""The name of `signs` in a site file."""


@dataclass(frozen=True)
class Expectations:
    """The signs of right fixes on held-out blocks of training, and the positions of these fixes."""

    xy_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    """(fix, 2) positions in the world's frame."""
    signs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, len(SIGNS))))
    """(fix, sign) signs in the order of chances.SIGNS."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The expectations in a site file, from its arrays.

        Raises KeyError if one is missing, ValueError if they do not fit together or a number is not
        finite.
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
        """How far the signs (sign,) of right fixes around a position (2,) exceed the usual.

        It is the difference of their medians; 0 if fewer than FEWEST lie within AROUND_M.
        """
        is_around = np.linalg.norm(self.xy_m - xy_m, axis=1) < AROUND_M
        if is_around.sum() < FEWEST:
            return np.zeros(len(SIGNS))
        return np.asarray(np.median(self.signs[is_around], axis=0) - self._usual)

    @cached_property
    def _usual(self) -> NDArray[np.float64]:
        """The median of each sign (sign,) over all right fixes of the day."""
        return np.asarray(np.median(self.signs, axis=0))
