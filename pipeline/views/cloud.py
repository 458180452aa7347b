"""PointNetVLAD's view: the points of a submap in, a fixed number of points around the sensor out.

The paper of Scan Context Images (SCI; Kim, Park and Kim, RA-L 2019, Sec. IV-B) compares itself with
PointNetVLAD and prepares the input of its network so. The numbers are those of its author's later
script (METHODS 3.2):

1. Average the points in small cubes.
2. Keep those in a cube around the sensor, without the points of the ground.
3. Draw a fixed number of them at random.
4. Centre them on their mean, and scale them to [−1, 1].
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import InputError
from pipeline.core.settings import Count, NotNegative, Positive, Range, Seed, checked
from pipeline.mapping.ground import find_plane
from pipeline.views import kernels


@dataclass(frozen=True)
@checked("view")
class Cloud:
    """The settings of the clouds."""

    schema: ClassVar[type[schemas.Views]] = schemas.CloudViews
    points: Count = 4096
    """Number of points of a cloud."""
    half_m: Positive = 25.0
    """Half the side of the cube around the sensor whose points are kept."""
    voxel_m: NotNegative = 0.1
    """Side of the cubes in which points are averaged; 0 takes them as they are."""
    plane_m: NotNegative = 0.2
    """Points nearer than this to the ground plane are ground; 0 keeps the ground."""
    slope_deg: Annotated[float, Range(0, 90, wording="an angle from 0 to 90")] = 20.0
    """A plane steeper than this is a wall, not the ground."""
    iterations: Count = 1000
    """Number of planes tried at most to find the ground."""
    seed: Seed = 0
    """Seeds the random numbers of every cloud, so that none depends on those before it."""

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float16]:
        """Make the cloud (points, 3) of a submap's points (n, 3).

        `points_m` are in metres in the frame of the submap's anchor, the newest scan: the origin is
        on the ground, z up. The cloud's points are relative to their mean, in units of `half_m`,
        clipped to [−1, 1]. Their order is random, so that the first m are a sample too. If fewer
        are left than wanted, all of them come first, then random ones again; if none is left, all
        are zero. Raises InputError for a wrong shape or a point that is not finite.
        """
        if points_m.ndim != 2 or points_m.shape[1] != 3:
            raise InputError(f"points of shape {points_m.shape}: expected (n, 3)")
        if not np.isfinite(points_m).all():
            raise InputError("a point is NaN or infinite: drop such points first")
        points = np.ascontiguousarray(points_m, np.float64)
        rng = np.random.default_rng(self.seed)

        # 1. Average the points in small cubes.
        if self.voxel_m > 0 and len(points):
            points = kernels.voxel_means(points, self.voxel_m)

        # 2. Keep the points around the sensor, without the ground.
        points = points[(np.abs(points) <= self.half_m).all(axis=1)]
        if self.plane_m > 0:
            points = points[~self._is_ground(points, rng)]
        if not len(points):
            return np.zeros((self.points, 3), np.float16)

        # 3. Draw a fixed number of them.
        rows = rng.permutation(len(points))[: self.points]
        repeated_rows = rng.integers(len(points), size=self.points - len(rows))
        points = points[np.concatenate([rows, repeated_rows])]

        # 4. Centre and scale them.
        scaled = (points - points.mean(axis=0)) / self.half_m
        return np.asarray(scaled.clip(-1, 1).astype(np.float16))

    def _is_ground(
        self, points: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.bool_]:
        """True for the points (n, 3) that lie on the ground; none if no ground is found."""
        ground_plane = find_plane(points, self.plane_m, self.slope_deg, self.iterations, rng)
        if ground_plane is None:
            return np.zeros(len(points), bool)
        # The plane is a x + b y + z = height_m. Distances are measured along z, where the margin is
        # wider by the slope, and in float32, as `find_plane` counts the points near it.
        a, b, height_m = ground_plane
        x, y, z = points.T.astype(np.float32, order="C")
        margin_m = self.plane_m * math.sqrt(a * a + b * b + 1)
        return np.asarray(np.abs(a * x + b * y + z - height_m) < margin_m)
