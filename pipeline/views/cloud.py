"""PointNetVLAD's input: a fixed number of points around the sensor, without the ground.

Preprocessing of the SCI paper (RA-L 2019, Sec. IV-B), whose numbers are those of its author's later
script (METHODS 3.2).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, NotNegative, Positive, Seed, check
from pipeline.mapping.ground import plane
from pipeline.views import kernels


@dataclass(frozen=True)
class Cloud:
    """Settings of a submap's cloud."""

    schema: ClassVar[type[schemas.Views]] = schemas.CloudViews
    points: Count = 4096
    half_m: Positive = 25.0
    """Half the side of the cube around the sensor that is kept."""
    voxel_m: NotNegative = 0.1
    """Points are averaged in cubes of this side first; 0 takes them as they are."""
    plane_m: NotNegative = 0.2
    """Points nearer than this to the ground plane are ground; 0 keeps the ground."""
    slope_deg: float = 20.0
    """A plane steeper than this is no ground but a wall."""
    iterations: Count = 1000
    """Planes tried at most."""
    seed: Seed = 0
    """The same for every cloud, so a view does not depend on those before it."""

    def __post_init__(self) -> None:
        check(self, "view")
        if not 0 <= self.slope_deg <= 90:
            raise ConfigError(f"view.slope_deg={self.slope_deg}: expected an angle from 0 to 90")

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.float16]:
        """Points (points, 3) about their mean in units of `half_m`, in [−1, 1], of points (n, 3) in
        metres, z up.

        They come in a random order: the first m are a sample too. Where fewer are left than wanted
        all of them come, then random ones again; zeros where none is left. Raises InputError for a
        wrong shape or a point that is not finite.
        """
        if points_m.ndim != 2 or points_m.shape[1] != 3:
            raise InputError(f"points of shape {points_m.shape}: expected (n, 3)")
        if not np.isfinite(points_m).all():
            raise InputError("a point is NaN or infinite: drop such points first")
        points = np.ascontiguousarray(points_m, np.float64)
        if self.voxel_m > 0 and len(points):
            points = kernels.voxel_means(points, self.voxel_m)
        rng = np.random.default_rng(self.seed)
        points = points[(np.abs(points) <= self.half_m).all(axis=1)]
        if self.plane_m > 0:
            points = points[~self._ground(points, rng)]
        if not len(points):
            return np.zeros((self.points, 3), np.float16)
        rows = rng.permutation(len(points))[: self.points]
        points = points[
            np.concatenate([rows, rng.integers(len(points), size=self.points - len(rows))])
        ]
        cloud: NDArray[np.float16] = (
            ((points - points.mean(axis=0)) / self.half_m).clip(-1, 1).astype(np.float16)
        )
        return cloud

    def _ground(self, points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.bool_]:
        """Which points (n, 3) lie on the ground; none if there is none."""
        if not (ground_plane := plane(points, self.plane_m, self.slope_deg, self.iterations, rng)):
            return np.zeros(len(points), bool)
        a, b, c = ground_plane
        x, y, z = points.T.astype(np.float32, order="C")
        ground: NDArray[np.bool_] = np.abs(a * x + b * y + z - c) < self.plane_m * math.sqrt(
            a * a + b * b + 1
        )
        return ground
