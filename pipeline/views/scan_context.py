"""Scan Context and its colour image, the SCI: the points of a submap in, an image of heights out.

A Scan Context (Kim and Kim, IROS 2018; METHODS 1.1) divides the plane around the sensor into rings
and sectors, and holds the highest point of each bin. A Scan Context Image (Kim, Park and Kim, RA-L
2019; METHODS 2.1) shows these heights in the colours of Matlab's jet.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import InputError
from pipeline.core.settings import NotNegative, Positive, Side, Whole, checked
from pipeline.views import kernels


@dataclass(frozen=True)
@checked("view")
class ScanContext:
    """The settings of a Scan Context; the defaults are those of the authors' Matlab code."""

    schema: ClassVar[type[schemas.Views]] = schemas.ScanContextViews
    rings: Side = 40
    sectors: Side = 120
    max_range_m: Positive = 80.0
    voxel_m: NotNegative = 0.5
    """Side of the cubes in which points are averaged first; 0 takes them as they are."""
    min_points: Whole = 5
    """A bin with fewer points than this, once averaged, is taken for noise and left empty."""
    beyond: Literal["last_ring", "drop"] = "last_ring"
    """What becomes of points beyond `max_range_m`; the authors put them into the last ring."""
    mirror: bool = False
    """Whether y is negated, so that columns run clockwise, as with the authors' NCLT reader."""

    @property
    def shape(self) -> tuple[int, int]:
        """The shape of an image: rings, sectors."""
        return (self.rings, self.sectors)

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Compute the Scan Context (rings, sectors) of points (n, 3), z up from the ground.

        A bin holds the height of its highest point in metres, or 0 if it is empty. Row 0 is the
        nearest ring, column 0 the sector that begins at +x; columns run counter-clockwise. A ring
        includes its inner border and not its outer one, a sector its last border and not its first.
        Raises InputError for a wrong shape or a point that is not finite.
        """
        points = np.ascontiguousarray(points_m)
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points of shape {points.shape}: expected (n, 3)")
        if self.mirror:
            points = points * np.array([1, -1, 1], points.dtype)
        if self.voxel_m > 0 and len(points):
            if not np.isfinite(points).all():
                raise InputError("a point is NaN or infinite: drop such points first")
            points = kernels.voxel_means(points, self.voxel_m)
        heights, is_finite = kernels.bin_heights(
            points.reshape(-1),
            self.rings,
            self.sectors,
            self.max_range_m,
            clamp=self.beyond == "last_ring",
            min_points=self.min_points,
        )
        if not is_finite:
            raise InputError("a point is NaN or infinite: drop such points first")
        return np.asarray(heights.reshape(self.shape))


def quantize(
    heights_m: NDArray[np.float32], h_min_m: float = 0.0, h_max_m: float = 15.0
) -> NDArray[np.uint8]:
    """Heights clipped to a range and scaled to 0…255, halves rounded up (METHODS 2.1)."""
    if not h_max_m > h_min_m:
        raise InputError(f"heights from {h_min_m} to {h_max_m}: expected an increasing range")
    clipped_m = np.clip(heights_m, h_min_m, h_max_m).astype(np.float64)
    share = (clipped_m - h_min_m) / (h_max_m - h_min_m)
    return np.asarray(np.floor(share * 255 + 0.5).astype(np.uint8))


def colorize(
    heights_m: NDArray[np.float32], h_min_m: float = 0.0, h_max_m: float = 15.0
) -> NDArray[np.uint8]:
    """The SCI (…, rings, sectors, 3) of heights (…, rings, sectors), in Matlab's jet."""
    return np.asarray(colours("jet")[quantize(heights_m, h_min_m, h_max_m)])


@lru_cache
def colours(colormap: Literal["jet", "grey"]) -> NDArray[np.uint8]:
    """The colour (256, channels) of each quantized height.

    `jet` is Matlab's jet(255) in three channels, `grey` the height itself in one. Matlab clamps its
    1-based index, so heights 0 and 1 share the first colour.
    """
    if colormap == "grey":
        return np.arange(256, dtype=np.uint8)[:, None]
    index = np.arange(256).clip(1) - 1
    return np.asarray(np.rint(255 * jet(255)[index]).astype(np.uint8))


def jet(m: int) -> NDArray[np.float64]:
    """Matlab's jet(m), (m, 3) in [0, 1], which differs from matplotlib's map of that name.

    Each channel is the same ramp up, plateau and ramp down, shifted and cut off at the ends.
    """
    n = math.ceil(m / 4)
    ramp = np.concatenate([np.arange(1, n + 1), np.full(n - 1, n), np.arange(n, 0, -1)]) / n
    green = math.ceil(n / 2) - (m % 4 == 1) + np.arange(1, len(ramp) + 1)
    table = np.zeros((m, 3))
    for channel, index in enumerate((green + n, green, green - n)):
        inside = (index >= 1) & (index <= m)
        is_cut_at_start = channel == 2
        shown = ramp[-inside.sum() :] if is_cut_at_start else ramp[: inside.sum()]
        table[index[inside] - 1, channel] = shown
    return table
