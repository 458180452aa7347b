"""Registration: aligns a cloud with another from a first guess (generalised ICP; METHODS 9.3)."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, Positive, check

Points = NDArray[np.float64]
LEAST_ALONG = 0.005
"""Share of the squared normals that looks along a direction; of a bare plane, whose normals are
noisy, it is less."""
NEAR_ENOUGH_M = 0.02
NEAR_ENOUGH_RAD = 0.01
"""An approach ends with a step and a turn below these: the refinement does the rest."""
LEAST_OFF_M = 0.01
"""Clouds are not believed to fit better than this."""


@dataclass(frozen=True)
class Alignment:
    """Where a source cloud stands in a target's frame."""

    target_T_source: NDArray[np.float64]
    """(4, 4)."""
    overlap: float
    """Share of the source's voxels that have one of the target's nearer than `inlier_m`."""
    covariance: NDArray[np.float64]
    """(6, 6) of a small turn about x, y, z in radians, then of a step along x, y, z in metres, in
    the source's frame; infinite where the clouds leave a direction open."""

    @property
    def spread_m(self) -> float:
        """The position's standard deviation along its widest direction."""
        steps = self.covariance[3:, 3:]
        return float(np.sqrt(np.linalg.eigvalsh(steps)[-1])) if np.isfinite(steps).all() else np.inf


NOWHERE = Alignment(np.eye(4), 0.0, np.full((6, 6), np.inf))
"""What is known where there is too little to register."""


@dataclass(frozen=True)
class Cloud:
    """A cloud thinned to one point a voxel, with the covariances of their neighbours and a tree."""

    points: small_gicp.PointCloud
    tree: small_gicp.KdTree
    cell_m: float
    rough_m: float
    neighbours: int

    @cached_property
    def rough(self) -> small_gicp.PointCloud:
        """The points once more, one a voxel of `rough_m`: as many as an approach takes."""
        return small_gicp.preprocess_points(self.xyz_m, self.rough_m, self.neighbours)[0]

    @cached_property
    def cells(self) -> small_gicp.GaussianVoxelMap:
        """The Gaussians of the thinned points, one in each cell of `cell_m`."""
        gaussians = small_gicp.GaussianVoxelMap(self.cell_m)
        gaussians.insert(self.points)
        return gaussians

    @cached_property
    def xyz_m(self) -> Points:
        """The thinned points (n, 3)."""
        return np.asarray(self.points.points())[:, :3]

    @cached_property
    def sample_m(self) -> Points:
        """Half of the thinned points (n / 2, 3), drawn at random but always the same.

        Shares need no more.
        """
        count = len(self.xyz_m)
        sample_rows = np.random.default_rng(0).permutation(count)[: (count + 1) // 2]
        return self.xyz_m[np.sort(sample_rows)]

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """The surface normals (n, 3) at the thinned points."""
        return np.asarray(self.points.normals())[:, :3]

    def nearest(self, points_m: Points) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Find the thinned point nearest to each of points (n, 3): its row (n,) and distance (n,).

        The points are in this cloud's frame, distances in metres.
        """
        rows, squares_m2 = self.tree.batch_nearest_neighbor_search(points_m)
        return np.asarray(rows, np.int64), np.sqrt(np.asarray(squares_m2, np.float64))


class Approach(NamedTuple):
    """Where a source cloud roughly stands in a target's frame."""

    target_T_source: NDArray[np.float64]
    """(4, 4)."""
    overlap: float
    """Share of the source's rough points that have one of the target's nearer than `reach_m`."""


@dataclass(frozen=True)
class Registration:
    """Generalised ICP between thinned clouds, in two steps (both in small_gicp).

    The approach pairs few points with one Gaussian a wide cell of the target (Koide, ICRA 2021): it
    comes near from some metres away. The refinement pairs points with points (Segal, RSS 2009).
    """

    voxel_m: Positive = 0.5
    neighbours: int = 10
    """Points that each covariance is estimated from."""
    cell_m: Positive = 4.0
    """Width of the approach's cells."""
    rough_m: Positive = 2.0
    """The approach takes one point of the source a voxel of this width."""
    reach_m: Positive = 1.0
    """Largest distance of a pair of points in the refinement."""
    iterations: Count = 10
    """At most, in each step."""
    inlier_m: Positive = 0.5
    least_voxels: int = 100
    """Clouds of fewer voxels have too little to hold on to."""

    def __post_init__(self) -> None:
        check(self, "registration")
        if not self.cell_m > self.reach_m:
            raise ConfigError(
                f"registration.cell_m={self.cell_m}: expected more than "
                f"registration.reach_m={self.reach_m}"
            )
        for name, least in (("neighbours", 5), ("least_voxels", self.neighbours)):
            if not getattr(self, name) >= least:
                raise ConfigError(
                    f"registration.{name}={getattr(self, name)}: expected at least {least}"
                )

    def align(
        self, target_points_m: Points, source_points_m: Points, target_T_source: NDArray[np.float64]
    ) -> Alignment:
        """Align source points (m, 3) with target points (n, 3) from a first guess (4, 4).

        All lengths are in metres. Raises InputError for points or a guess that are not finite or
        not of that shape, and for a cloud of too few voxels.
        """
        guess = np.asarray(target_T_source, np.float64)
        if guess.shape != (4, 4) or not np.isfinite(guess).all():
            raise InputError(f"a first guess of shape {guess.shape}: expected a finite pose (4, 4)")
        target = self.prepare(target_points_m)
        source = self.prepare(source_points_m)
        return self.refine(target, source, self.approach(target, source, guess).target_T_source)

    def prepare(self, points_m: Points) -> Cloud:
        """Thin points (n, 3) in metres to a cloud; raises InputError if it cannot be registered."""
        points_m = np.asarray(points_m, np.float64)
        if points_m.ndim != 2 or points_m.shape[1] != 3 or not np.isfinite(points_m).all():
            raise InputError(f"points of shape {points_m.shape}: expected finite ones (n, 3)")
        thinned, tree = small_gicp.preprocess_points(points_m, self.voxel_m, self.neighbours)
        cloud = Cloud(thinned, tree, self.cell_m, self.rough_m, self.neighbours)
        if cloud.points.size() < self.least_voxels:
            content = f"{len(points_m)} points in {cloud.points.size()} voxels of {self.voxel_m} m"
            raise InputError(f"{content}: registration needs {self.least_voxels} voxels")
        return cloud

    def approach(
        self, target: Cloud, source: Cloud, target_T_source: NDArray[np.float64]
    ) -> Approach:
        """Bring a prepared cloud near its pose, from a guess (4, 4) that is metres off."""
        result = small_gicp.align(
            target.cells,
            source.rough,
            target_T_source,
            max_correspondence_distance=self.cell_m,
            max_iterations=self.iterations,
            translation_epsilon=NEAR_ENOUGH_M,
            rotation_epsilon=NEAR_ENOUGH_RAD,
        )
        poses = (np.asarray(result.T_target_source), target_T_source)  # a guess may be better
        shares = [self._near(target, source, pose) for pose in poses]
        best = int(np.argmax(shares))
        return Approach(poses[best], shares[best])

    def refine(
        self, target: Cloud, source: Cloud, target_T_source: NDArray[np.float64]
    ) -> Alignment:
        """Align two prepared clouds from a pose (4, 4) that is nearly right."""
        result = small_gicp.align(
            target.points,
            source.points,
            target.tree,
            target_T_source,
            max_correspondence_distance=self.reach_m,
            max_iterations=self.iterations,
        )
        target_T_source = np.asarray(result.T_target_source)
        moved_m = moved(target_T_source, source.xyz_m)
        nearest, distances_m = target.nearest(moved_m)
        paired = distances_m < self.inlier_m
        normals = target.normals[nearest[paired]]
        off_m = np.einsum("nx,nx->n", normals, moved_m[paired] - target.xyz_m[nearest[paired]])
        if min(_least_along(normals), _least_along(source.normals[paired])) < LEAST_ALONG:
            return Alignment(target_T_source, float(paired.mean()), np.full((6, 6), np.inf))
        covariance = _covariance(source.xyz_m[paired], normals @ target_T_source[:3, :3], off_m)
        return Alignment(target_T_source, float(paired.mean()), covariance)

    def _near(self, target: Cloud, source: Cloud, target_T_source: NDArray[np.float64]) -> float:
        """The share of the source's rough points that the target has within `reach_m`."""
        rough_m = np.asarray(source.rough.points())[:, :3]
        _, distances_m = target.nearest(moved(target_T_source, rough_m))
        return float((distances_m < self.reach_m).mean())


def moved(a_T_b: NDArray[np.float64], points_m: Points) -> Points:
    """Transform points (n, 3) of frame b into frame a."""
    return np.asarray(points_m @ a_T_b[:3, :3].T + a_T_b[:3, 3])


def _least_along(normals: NDArray[np.float64]) -> float:
    """The mean square of normals (n, 3) along the direction that the fewest look along.

    It is 0 where there are too few to say.
    """
    return (
        float(np.linalg.eigvalsh(normals.T @ normals / len(normals))[0])
        if len(normals) > 6
        else 0.0
    )


def _covariance(
    points_m: Points, normals: NDArray[np.float64], off_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The covariance (6, 6) of an alignment: the inverse Hessian of point to plane.

    Points (n, 3) lie `off_m` (n,) off planes with normals (n, 3).
    """
    slopes = np.column_stack([np.cross(points_m, normals), normals])
    variance = max(float(off_m @ off_m) / (len(off_m) - 6), LEAST_OFF_M**2)
    return np.asarray(variance * np.linalg.inv(slopes.T @ slopes))
