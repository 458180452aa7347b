"""Scan Context, the highest point of every ring and sector around the sensor, and its colour image,
the SCI.

Scan Context: Kim and Kim, IROS 2018; Scan Context Images: Kim, Park and Kim, RA-L 2019; METHODS 1.1
and 2.1.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import NotNegative, Positive, Side, Whole, check
from pipeline.views import kernels


@dataclass(frozen=True)
class ScanContext:
    """Settings of a submap's Scan Context; the defaults are the authors' Matlab reference."""

    schema: ClassVar[type[schemas.Views]] = schemas.ScanContextViews
    rings: Side = 40
    sectors: Side = 120
    max_range_m: Positive = 80.0
    voxel_m: NotNegative = 0.5
    """Points are averaged in cubes of this side first; 0 takes them as they are."""
    min_points: Whole = 5
    """A bin with fewer (averaged) points is noise and empty."""
    beyond: Literal["last_ring", "drop"] = "last_ring"
    """Points beyond max_range_m: the authors put them into the outermost ring."""
    mirror: bool = False
    """Columns clockwise seen from above (y negated), as the authors' NCLT reader makes them."""

    def __post_init__(self) -> None:
        check(self, "view")

    @property
    def shape(self) -> tuple[int, int]:
        """Of an image: rings, sectors."""
        return (self.rings, self.sectors)

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Heights (rings, sectors) in metres of points (n, 3), z up from the ground; 0 where a bin
        is empty.

        Row 0 is the nearest ring, column 0 the sector that starts at +x and turns
        counter-clockwise; a sector holds (width·k, width·(k+1)], a ring [width·k, width·(k+1)).
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
        heights, finite = kernels.bin_heights(
            points.reshape(-1),
            self.rings,
            self.sectors,
            self.max_range_m,
            self.beyond == "last_ring",
            self.min_points,
        )
        if not finite:
            raise InputError("a point is NaN or infinite: drop such points first")
        image: NDArray[np.float32] = heights.reshape(self.shape)
        return image


def quantize(
    heights_m: NDArray[np.float32], h_min_m: float = 0.0, h_max_m: float = 15.0
) -> NDArray[np.uint8]:
    """Heights as 0…255: clipped to [h_min_m, h_max_m], scaled, halves rounded up (METHODS 2.1)."""
    if not h_max_m > h_min_m:
        raise InputError(f"heights from {h_min_m} to {h_max_m}: expected an increasing range")
    share = (np.clip(heights_m, h_min_m, h_max_m).astype(np.float64) - h_min_m) / (
        h_max_m - h_min_m
    )
    quantized: NDArray[np.uint8] = np.floor(share * 255 + 0.5).astype(np.uint8)
    return quantized


def colorize(
    heights_m: NDArray[np.float32], h_min_m: float = 0.0, h_max_m: float = 15.0
) -> NDArray[np.uint8]:
    """The SCI (…, rings, sectors, 3) of heights (…, rings, sectors): Matlab's jet of the quantized
    heights."""
    image: NDArray[np.uint8] = colours("jet")[quantize(heights_m, h_min_m, h_max_m)]
    return image


@lru_cache
def colours(colormap: Literal["jet", "grey"]) -> NDArray[np.uint8]:
    """Colour (256, channels) of each quantized height: Matlab's jet(255), or the height itself in
    one channel.

    Matlab looks a floating index up 1-based and clamps it, so 0 and 1 share the first entry.
    """
    if colormap == "grey":
        return np.arange(256, dtype=np.uint8)[:, None]
    if colormap != "jet":
        raise ConfigError(f"colormap={colormap}: expected jet or grey")
    table: NDArray[np.uint8] = np.rint(255 * jet(255)[np.arange(256).clip(1) - 1]).astype(np.uint8)
    return table


def jet(m: int) -> NDArray[np.float64]:
    """Matlab's jet(m), (m, 3) in [0, 1]; matplotlib's map of that name is another one."""
    n = math.ceil(m / 4)
    ramp = np.concatenate([np.arange(1, n + 1), np.full(n - 1, n), np.arange(n, 0, -1)]) / n
    green = math.ceil(n / 2) - (m % 4 == 1) + np.arange(1, len(ramp) + 1)
    table = np.zeros((m, 3))
    for channel, index in enumerate((green + n, green, green - n)):
        inside = (index >= 1) & (index <= m)
        table[index[inside] - 1, channel] = (
            ramp[-inside.sum() :] if channel == 2 else ramp[: inside.sum()]
        )
    return table
