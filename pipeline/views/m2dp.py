"""M2DP: a cloud's points counted on many planes through its middle, and the first singular vectors
of the counts.

He, Wang and Zhang, IROS 2016; METHODS 3.1. The planes stand in the cloud's own principal axes. It
is in the method's nature that rounding chooses the axes where two variances are equal, and the
sectors where a cloud lies on one plane.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import InputError
from pipeline.core.settings import Side, check
from pipeline.views import m2dp_kernel as kernel

LAST_EDGE_M = 0.001
"""Added to the outermost circle's border."""
SPOT_M = 1e-6
"""A cloud that reaches no further from its mean has no shape."""


@dataclass(frozen=True)
class M2dp:
    """The defaults are the authors'."""

    schema: ClassVar[type[schemas.Views]] = schemas.SignatureViews
    azimuths: Side = 4
    elevations: Side = 16
    """A plane for each azimuth from −90° to 90° and each elevation from 0° to 90° of its normal,
    both ends included."""
    circles: Side = 8
    """Their radii grow with the square of their number, to the farthest point."""
    sectors: Side = 16
    """Of each circle; counting is some thirty times slower with another number."""

    def __post_init__(self) -> None:
        check(self, "view")

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """The signature (azimuths · elevations + circles · sectors,) of points (n, 3): a number a
        plane, then one a bin.

        Each of the two parts has length 1 and no negative number. Where fewer than three points, or
        points in one spot, have no shape it is zero, √2 from every other. Raises InputError for a
        wrong array or a point that is not finite.
        """
        counts = self.counts(points_m)
        if not counts.any():
            return np.zeros(sum(counts.shape), np.float32)
        return np.concatenate(kernel.leading(counts / len(points_m))).astype(np.float32)

    def counts(self, points_m: NDArray[np.floating]) -> NDArray[np.int64]:
        """How many points each plane has in each bin (plane, circle · sector), sectors from −x on
        counter-clockwise."""
        points = np.ascontiguousarray(points_m, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points of shape {points.shape}: expected (n, 3)")
        mean, scatter, farthest_m = kernel.moments(points)
        if len(points) and not np.isfinite(scatter).all():
            raise InputError("a point is NaN or infinite: drop such points first")
        shape = (self.azimuths * self.elevations, self.circles, self.sectors)
        if len(points) < 3 or farthest_m < SPOT_M:
            return np.zeros((shape[0], shape[1] * shape[2]), np.int64)
        radii = np.linspace(0, np.sqrt(farthest_m), self.circles + 1) ** 2
        radii[-1] += LAST_EDGE_M
        angles = np.linspace(-np.pi, np.pi, self.sectors + 1)
        place = (
            kernel.PLACE
            if self.sectors == kernel.QUICK
            else np.arange(self.sectors, dtype=np.uint32)
        )
        axes = principal_axes(scatter)
        plane_axes = planes(self.azimuths, self.elevations)
        tables = kernel.bin_counts(points, mean, axes, farthest_m, plane_axes, radii, angles, place)
        counts: NDArray[np.int64] = tables.reshape(shape[0], -1, *shape[1:]).sum(
            axis=1, dtype=np.int64
        )[..., place]
        return counts.reshape(shape[0], -1)


def principal_axes(scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes (3, 3) as columns, of largest variance first; the largest coefficient of each is
    positive, as Matlab has it.

    So they may be left-handed, and a turn of the cloud may flip one.
    """
    axes: NDArray[np.float64] = np.linalg.eigh(scatter)[1][:, ::-1]
    flipped: NDArray[np.float64] = np.ascontiguousarray(
        axes * np.sign(axes[np.abs(axes).argmax(axis=0), range(3)])
    )
    return flipped


@lru_cache
def planes(azimuths: int, elevations: int) -> NDArray[np.float64]:
    """The axes (plane, 2, 3) of each plane: e_x less its part along the normal, not made longer,
    and the normal × that."""
    azimuth = np.repeat(np.linspace(-np.pi / 2, np.pi / 2, azimuths), elevations)
    elevation = np.tile(np.linspace(0, np.pi / 2, elevations), azimuths)
    normal = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )
    x = np.eye(3)[0] - normal[:, :1] * normal
    return np.stack([x, np.cross(normal, x)], axis=1)
