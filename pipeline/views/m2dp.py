"""M2DP (He, Wang and Zhang, IROS 2016; METHODS 3.1): the points of a submap in, a signature of 192
numbers out.

1. Centre the points on their mean, and turn them to their principal axes.
2. Project them on many planes through the mean, and count them by circle and sector on each.
3. The signature is the first left and right singular vector of these counts (plane, bin).

Rounding chooses the axes where two variances are equal, and the sectors where all points lie on one
plane; that is in the method's nature.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import InputError
from pipeline.core.settings import Side, checked
from pipeline.views import m2dp_kernel as kernel

LAST_EDGE_M = 0.001
"""Added to the radius of the outermost circle, so that the farthest point lies within it."""
SPOT_M = 1e-6
"""A cloud that reaches no further than this from its mean is one spot, without a shape."""


@dataclass(frozen=True)
@checked("view")
class M2dp:
    """The settings of the signature; the defaults are the authors'."""

    schema: ClassVar[type[schemas.Views]] = schemas.SignatureViews
    azimuths: Side = 4
    """Number of azimuths of the planes' normals, from −90° to 90°, both included. There is a plane
    for each azimuth and each elevation."""
    elevations: Side = 16
    """Number of elevations of the planes' normals, from 0° to 90°, both included."""
    circles: Side = 8
    """Number of circles on a plane. Their radii grow as the square of their number, up to the
    farthest point."""
    sectors: Side = 16
    """Number of sectors of each circle; with another one, counting is some thirty times slower."""

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Compute the signature (azimuths · elevations + circles · sectors,) of points (n, 3).

        It has a number for each plane, then one for each bin. Each of these parts has length 1 and
        no negative number. Fewer than three points, or points in one spot, have no shape: all
        numbers are zero, at a distance of √2 from every other signature. Raises InputError for a
        wrong shape or a point that is not finite.
        """
        counts = self.counts(points_m)
        if not counts.any():
            return np.zeros(sum(counts.shape), np.float32)
        of_planes, of_bins = kernel.first_singular_vectors(counts / len(points_m))
        return np.concatenate([of_planes, of_bins]).astype(np.float32)

    def counts(self, points_m: NDArray[np.floating]) -> NDArray[np.int64]:
        """Count the points (n, 3) in each bin of each plane (plane, circle · sector).

        Sectors run fastest, from −x on counter-clockwise.
        """
        points = np.ascontiguousarray(points_m, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points of shape {points.shape}: expected (n, 3)")
        mean, scatter, farthest_m = kernel.moments(points)
        if len(points) and not np.isfinite(scatter).all():
            raise InputError("a point is NaN or infinite: drop such points first")
        n_planes = self.azimuths * self.elevations
        if len(points) < 3 or farthest_m < SPOT_M:
            return np.zeros((n_planes, self.circles * self.sectors), np.int64)
        radii = np.linspace(0, np.sqrt(farthest_m), self.circles + 1) ** 2
        radii[-1] += LAST_EDGE_M
        angles = np.linspace(-np.pi, np.pi, self.sectors + 1)
        # The kernel counts sector s at `place[s]` of its tables.
        place = np.arange(self.sectors, dtype=np.uint32)
        if self.sectors == kernel.QUICK:
            place = kernel.PLACE
        axes = principal_axes(scatter)
        plane_axes = planes(self.azimuths, self.elevations)
        tables = kernel.bin_counts(
            points,
            mean,
            axes,
            farthest_m,
            planes=plane_axes,
            radii=radii,
            angles=angles,
            place=place,
        )
        tables = tables.reshape(n_planes, kernel.COPIES, self.circles, self.sectors)
        counts: NDArray[np.int64] = tables.sum(axis=1, dtype=np.int64)[..., place]
        return counts.reshape(n_planes, -1)


def principal_axes(scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """The principal axes (3, 3) of a scatter matrix (3, 3) as columns, largest variance first.

    The largest coefficient of each axis is positive, as in Matlab. So they may be left-handed, and
    a turn of the cloud may flip one.
    """
    _, axes_by_rising_variance = np.linalg.eigh(scatter)
    axes: NDArray[np.float64] = axes_by_rising_variance[:, ::-1]
    largest_coefficients = axes[np.abs(axes).argmax(axis=0), range(3)]
    return np.asarray(np.ascontiguousarray(axes * np.sign(largest_coefficients)))


@lru_cache
def planes(azimuths: int, elevations: int) -> NDArray[np.float64]:
    """The two axes (plane, 2, 3) of each plane, in the principal axes.

    The first is the x axis without its part along the normal, not brought to length 1; the second
    is the cross product of the normal and the first.
    """
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
    # x axis − (x axis · normal) normal, where x axis · normal is the normal's first number
    x = np.eye(3)[0] - normal[:, :1] * normal
    return np.stack([x, np.cross(normal, x)], axis=1)
