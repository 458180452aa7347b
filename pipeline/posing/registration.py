"""Registration: aligns one cloud with another from a first guess (generalised ICP; METHODS 9.3).

In: the points of a target (a training submap) and of a source (a query), and a guess of the
source's pose in the target's frame. Out: the refined pose, its covariance, and how much of the
source overlaps with the target. The steps:

1. `prepare`: thin both clouds to one point a voxel.
2. `approach`: from metres away, align few points with wide cells of the target.
3. `refine`: align all thinned points with the target's points.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import transformed
from pipeline.core.settings import Count, Positive, checked

Points = NDArray[np.float64]
"""(n, 3) in metres."""
LEAST_ALONG = 0.005
"""Least mean square of the surface normals along any direction. Below it, no surface constrains the
pose in this direction: the noisy normals of a bare plane have less."""
NEAR_ENOUGH_M = 0.02
NEAR_ENOUGH_RAD = 0.01
"""An approach ends at a step and a turn below these: the refinement does the rest."""
LEAST_OFF_M = 0.01
"""The residuals of an alignment count as at least this large."""
DEPENDENT_M = 4.0
"""The residuals within a cube of this side depend on one another: they are of one wall or tree."""


@dataclass(frozen=True)
class Alignment:
    """The result of a registration: the pose of a source cloud in a target's frame."""

    target_T_source: NDArray[np.float64]
    """(4, 4) the pose."""
    overlap: float
    """Share of the source's voxels that have a voxel of the target nearer than `inlier_m`."""
    covariance: NDArray[np.float64]
    """(6, 6) of a small turn about x, y, z in radians, then of a step along x, y, z in metres, in
    the source's frame; infinite if no surface constrains the pose in some direction. The residuals
    count as independent."""
    dependent_covariance: NDArray[np.float64]
    """The same, where the residuals of a cube of DEPENDENT_M depend on one another."""

    @property
    def spread_m(self) -> float:
        """The position's standard deviation along its widest direction."""
        steps = self.covariance[3:, 3:]
        return float(np.sqrt(np.linalg.eigvalsh(steps)[-1])) if np.isfinite(steps).all() else np.inf


NOWHERE = Alignment(np.eye(4), 0.0, np.full((6, 6), np.inf), np.full((6, 6), np.inf))
"""Stands for an alignment if there are too few points to register."""


@dataclass(frozen=True)
class Cloud:
    """A cloud prepared for registration: thinned, with covariances and a search tree."""

    points: small_gicp.PointCloud
    """One point a voxel, each with the covariance of the points around it."""
    tree: small_gicp.KdTree
    """Finds the nearest of these points."""
    cell_m: float
    rough_m: float
    neighbours: int
    """The settings of `Registration` that the cloud was prepared with."""

    @cached_property
    def rough(self) -> small_gicp.PointCloud:
        """Fewer points, one a voxel of `rough_m`, for the approach."""
        rough, _ = small_gicp.preprocess_points(self.xyz_m, self.rough_m, self.neighbours)
        return rough

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
        """Half of the thinned points (n / 2, 3), which are enough to estimate shares.

        They are drawn at random with a fixed seed.
        """
        count = len(self.xyz_m)
        sample_rows = np.random.default_rng(0).permutation(count)[: (count + 1) // 2]
        return self.xyz_m[np.sort(sample_rows)]

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """The surface normals (n, 3) at the thinned points."""
        return np.asarray(self.points.normals())[:, :3]

    def nearest(self, points_m: Points) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The row (n,) of the thinned point nearest to each of n points, and its distance (n,).

        The points (n, 3) are in this cloud's frame, distances in metres.
        """
        rows, squares_m2 = self.tree.batch_nearest_neighbor_search(points_m)
        return np.asarray(rows, np.int64), np.sqrt(np.asarray(squares_m2, np.float64))


class Approach(NamedTuple):
    """The result of an approach: the rough pose of a source cloud in a target's frame."""

    target_T_source: NDArray[np.float64]
    """(4, 4) the pose."""
    overlap: float
    """Share of the source's rough points that have a point of the target nearer than `reach_m`."""


@dataclass(frozen=True)
@checked("registration")
class Registration:
    """Generalised ICP between thinned clouds, in two steps (both by small_gicp).

    The approach pairs few points with Gaussians, one for each wide cell of the target (Koide, ICRA
    2021), and so converges from some metres away. The refinement pairs points with points (Segal,
    RSS 2009).
    """

    voxel_m: Positive = 0.5
    """Width of the voxels that clouds are thinned to."""
    neighbours: int = 10
    """Number of points that each covariance is estimated from."""
    cell_m: Positive = 4.0
    """Width of the approach's cells."""
    rough_m: Positive = 2.0
    """Width of the voxels that the source is thinned to for the approach."""
    reach_m: Positive = 1.0
    """Largest distance of a pair of points in the refinement."""
    iterations: Count = 10
    """Largest number of iterations in each step."""
    inlier_m: Positive = 0.5
    """Points nearer than this after the refinement overlap."""
    least_voxels: int = 100
    """A cloud of fewer voxels cannot be registered."""

    def __post_init__(self) -> None:
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
        have another shape, and for a cloud of too few voxels.
        """
        guess = np.asarray(target_T_source, np.float64)
        if guess.shape != (4, 4) or not np.isfinite(guess).all():
            raise InputError(f"a first guess of shape {guess.shape}: expected a finite pose (4, 4)")
        target = self.prepare(target_points_m)
        source = self.prepare(source_points_m)
        return self.refine(target, source, self.approach(target, source, guess).target_T_source)

    def prepare(self, points_m: Points) -> Cloud:
        """Thin points (n, 3) in metres to a cloud.

        Raises InputError for points of another shape or not finite, and for too few voxels.
        """
        points_m = np.asarray(points_m, np.float64)
        if points_m.ndim != 2 or points_m.shape[1] != 3 or not np.isfinite(points_m).all():
            raise InputError(f"points of shape {points_m.shape}: expected finite points (n, 3)")
        thinned, tree = small_gicp.preprocess_points(points_m, self.voxel_m, self.neighbours)
        cloud = Cloud(thinned, tree, self.cell_m, self.rough_m, self.neighbours)
        if cloud.points.size() < self.least_voxels:
            content = f"{len(points_m)} points in {cloud.points.size()} voxels of {self.voxel_m} m"
            raise InputError(f"{content}: registration needs {self.least_voxels} voxels")
        return cloud

    def approach(
        self, target: Cloud, source: Cloud, target_T_source: NDArray[np.float64]
    ) -> Approach:
        """Bring a prepared cloud near its pose, from a guess (4, 4) that is some metres off.

        Returns the guess itself if its overlap is larger.
        """
        result = small_gicp.align(
            target.cells,
            source.rough,
            target_T_source,
            max_correspondence_distance=self.cell_m,
            max_iterations=self.iterations,
            translation_epsilon=NEAR_ENOUGH_M,
            rotation_epsilon=NEAR_ENOUGH_RAD,
        )
        poses = (np.asarray(result.T_target_source), target_T_source)
        overlaps = [self._rough_overlap(target, source, pose) for pose in poses]
        best = int(np.argmax(overlaps))
        return Approach(poses[best], overlaps[best])

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
        # The pairs of nearest points, and how far each lies off the target's surface.
        moved_m = transformed(target_T_source, source.xyz_m)
        nearest, distances_m = target.nearest(moved_m)
        is_paired = distances_m < self.inlier_m
        overlap = float(is_paired.mean())
        target_rows = nearest[is_paired]
        normals = target.normals[target_rows]
        off_m = np.einsum("nx,nx->n", normals, moved_m[is_paired] - target.xyz_m[target_rows])
        # The pose is unconstrained in a direction along which either cloud has no surface.
        if min(_least_along(normals), _least_along(source.normals[is_paired])) < LEAST_ALONG:
            return replace(NOWHERE, target_T_source=target_T_source, overlap=overlap)
        normals_in_source = normals @ target_T_source[:3, :3]  # rows n @ R are the columns Rᵀ n
        covariances = _covariances(source.xyz_m[is_paired], normals_in_source, off_m)
        return Alignment(target_T_source, overlap, *covariances)

    def _rough_overlap(
        self, target: Cloud, source: Cloud, target_T_source: NDArray[np.float64]
    ) -> float:
        """The share of the source's rough points with a point of the target within `reach_m`."""
        rough_m = np.asarray(source.rough.points())[:, :3]
        _, distances_m = target.nearest(transformed(target_T_source, rough_m))
        return float((distances_m < self.reach_m).mean())


def _least_along(normals: NDArray[np.float64]) -> float:
    """The mean square of normals (n, 3) along the direction in which it is least.

    It is 0 if there are too few normals to determine a pose.
    """
    if len(normals) <= 6:
        return 0.0
    return float(np.linalg.eigvalsh(normals.T @ normals / len(normals))[0])


def _covariances(
    points_m: Points, normals: NDArray[np.float64], off_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The covariances (6, 6) of an alignment, by its point-to-plane error.

    Points (n, 3) lie `off_m` (n,) off planes with normals (n, 3), all in the source's frame. The
    first is the inverse Hessian: all residuals are independent, and equally large. For the second
    only cubes are independent (the sandwich estimator, with clusters).
    """
    # The derivative (n, 6) of n · (p + turn × p + step) by the turn, p × n, and by the step, n.
    slopes = np.column_stack([np.cross(points_m, normals), normals])
    inverse = np.linalg.inv(slopes.T @ slopes)
    # A pose takes six degrees of freedom from the residuals.
    variance = max(float(off_m @ off_m) / (len(off_m) - 6), LEAST_OFF_M**2)
    # The sum (cube, 6) of the gradients of the points in each cube.
    cubes = np.floor(points_m / DEPENDENT_M).astype(np.int64)
    cubes -= cubes.min(axis=0)
    numbers = np.ravel_multi_index(tuple(cubes.T), tuple(cubes.max(axis=0) + 1))
    _, cube = np.unique(numbers, return_inverse=True)
    gradients = slopes * off_m[:, None]
    sums = np.column_stack([np.bincount(cube, gradient) for gradient in gradients.T])
    # Few cubes leave directions without a residual: each point is off by LEAST_OFF_M besides.
    dependent = inverse @ (sums.T @ sums) @ inverse + LEAST_OFF_M**2 * inverse
    return variance * inverse, dependent
