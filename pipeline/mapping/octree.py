"""The dynamic octree (Yin et al., IROS 2018; METHODS 4): from scans and odometry, an occupancy map.

The map is a cube of leaves around the robot. It moves along with the robot, and its log-odds decay
with the robot's motion, so that the drift of odometry does no harm. A leaf holds its log-odds of
being occupied, updated as in OctoMap (Hornung et al., Autonomous Robots 2013).

The leaves are kept in bricks, which are allocated when a ray touches them and freed when all of
their leaves are unknown again (`mapping.bricks`). OctoMap's inner nodes, each the highest of its
children, are not kept, since nothing reads them.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import NotNegative, Positive, Range, checked
from pipeline.mapping import octree_kernels as kernels
from pipeline.mapping.bricks import Bricks, bricks_of_a_ray, dense, empty, forget, with_room

Variance = tuple[float, float]
"""Variances of a motion: of its position in m², and of its turn in rad²; both are above 0."""
KNOWN_FROM = 1e-3
"""A leaf whose log-odds have decayed to less than this, in absolute value, is unknown again."""


@dataclass(frozen=True)
@checked("view.octree")
class Octree:
    """The settings of a map; the defaults are OctoMap's, and the IROS paper's scale for a car."""

    edge_m: Positive = 50.0
    """Edge of the root cube, whose middle is within a leaf of the robot."""
    depth: Annotated[int, Range(2, 9, wording="a whole number from 2 to 9")] = 7
    """Levels below the root: there are 2^depth leaves along an edge of the cube."""
    hit: float = 0.7
    """Probability that an unknown leaf is occupied after one scan with a point in it."""
    miss: float = 0.4
    """Probability that an unknown leaf is occupied after one scan with a ray through it."""
    lowest: float = 0.1192
    """Lower bound of a leaf's probability, so that later scans can still change it."""
    highest: float = 0.971
    """Upper bound of a leaf's probability."""
    motion: Literal["gaussian", "per_metre", "none"] = "gaussian"
    """How all log-odds decay with a motion u, measured in standard deviations (METHODS 4.3).

    `gaussian` multiplies them by exp(−|u|²/2) at each scan. `per_metre` multiplies them by
    exp(−|u| sigma_m / per_metre_m), which does not depend on the scan rate. With `none` nothing
    decays.
    """
    sigma: Literal["log", "constant"] = "constant"
    """The source of the deviations of `gaussian`. With `log` they come from the log's odometry for
    each motion (eq. 4 as written), and from the constants below if it gives none."""
    sigma_m: Positive = 2.0
    """Standard deviation of a motion's position."""
    sigma_rad: Positive = 0.5
    """Standard deviation of a motion's turn."""
    per_metre_m: Positive = 8.0
    """Straight path over which `per_metre` decays to 1/e. At one scan per metre, 8 m makes both
    ways of decay equal."""
    rays: Literal["end_voxel", "all"] = "end_voxel"
    """`end_voxel` casts one ray to the centre of each cell that holds points, as OctoMap does if it
    discretises; `all` casts one ray to every point."""
    max_range_m: NotNegative = 0.0
    """Range from the sensor at which longer rays are cut: they clear the cells up to this range,
    and hit nothing. 0 stands for half the root cube's diagonal."""
    sensor_height_m: float = 1.73
    """Height of the sensor, where rays start, above the origin of the vehicle's frame."""

    def __post_init__(self) -> None:
        if not 0 < self.lowest <= self.miss < 0.5 < self.hit <= self.highest < 1:
            numbers = (
                f"lowest={self.lowest}, miss={self.miss}, hit={self.hit} and highest={self.highest}"
            )
            raise ConfigError(
                f"view.octree: {numbers} must increase from 0 to 1, the first two below 0.5, the "
                "others above"
            )
        if not 0 <= self.sensor_height_m <= self.edge_m / 4:
            raise ConfigError(
                f"view.octree.sensor_height_m={self.sensor_height_m}: expected 0 to a quarter of "
                "edge_m"
            )

    @property
    def side(self) -> int:
        """Leaves along an edge of the root cube."""
        return int(2**self.depth)

    @property
    def leaf_m(self) -> float:
        """Edge of a leaf in metres."""
        return self.edge_m / self.side

    @property
    def reach_m(self) -> float:
        """Length of the longest ray that hits anything."""
        return self.max_range_m or math.sqrt(3) / 2 * self.edge_m

    def kept_share(
        self, moved_m: float, turned_rad: float, variance: Variance | None = None
    ) -> float:
        """The factor in (0, 1] by which a motion multiplies all log-odds (METHODS 4.3): 1 at rest.

        The robot moves by `moved_m` and turns by `turned_rad`. `variance` is the motion's variance
        by the log, if it gives one.
        """
        sigma_m = self.sigma_m
        sigma_rad = self.sigma_rad
        if self.motion == "gaussian" and self.sigma == "log" and variance is not None:
            sigma_m = math.sqrt(variance[0])
            sigma_rad = math.sqrt(variance[1])
        deviations = math.hypot(moved_m / sigma_m, turned_rad / sigma_rad)
        if self.motion == "gaussian":
            return math.exp(-0.5 * deviations**2)
        if self.motion == "per_metre":
            return math.exp(-deviations * self.sigma_m / self.per_metre_m)
        return 1.0

    def grow(self) -> "OctreeMap":
        """Make an empty map with these settings."""
        return OctreeMap(self)


class OctreeMap:
    """The map of one sequence. Its axes are those of odometry, its leaves whole multiples of
    `leaf_m` from odometry's origin."""

    bricks: Bricks
    """The known leaves."""
    lowest_leaf: NDArray[np.int64]
    """The lowest leaf (3,) of the root cube, counted from odometry's origin."""

    def __init__(self, octree: Octree) -> None:
        self.octree = octree
        self.lowest_leaf = np.zeros(3, np.int64)
        self.bricks = empty(octree.side)
        self._unhit_cells = np.empty(0, np.int64)
        self._odom_T_vehicle: NDArray[np.float64] | None = None
        self._hit_log_odds = np.float32(log_odds(octree.hit))
        self._miss_log_odds = np.float32(log_odds(octree.miss))
        self._min_log_odds = np.float32(log_odds(octree.lowest))
        self._max_log_odds = np.float32(log_odds(octree.highest))

    @property
    def leaf_m(self) -> float:
        """Edge of a leaf in metres."""
        return self.octree.leaf_m

    @property
    def corner_m(self) -> NDArray[np.float64]:
        """The lowest corner (3,) of the root cube, in odometry's frame."""
        return np.asarray(self.lowest_leaf * self.leaf_m, np.float64)

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """A copy (side, side, side) of the log-odds of all leaves, x-major; 0 is unknown."""
        return dense(self.bricks, self.lowest_leaf, self.octree.side)

    def insert(
        self,
        points_m: NDArray[np.floating],
        odom_T_vehicle: NDArray[np.float64],
        variance: Variance | None = None,
    ) -> None:
        """Add a scan (n, 3) in the vehicle's frame, taken at `odom_T_vehicle` (4, 4) (METHODS 4.4).

        `variance` is the variance by the log of the motion since the last scan, if it gives one.

        1. Mark the leaves that the rays of the scan cross, and those that hold a point.
        2. Move the root cube with the robot, by whole leaves, and forget the leaves that leave it.
        3. Let all log-odds decay by the motion since the last scan; then add one hit to each leaf
           that holds a point, and one miss to each leaf that rays only cross.

        Raises InputError for a wrong shape, or a pose or point that is not finite; the map is then
        unchanged.
        """
        points = np.ascontiguousarray(points_m, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points of shape {points.shape}: expected (n, 3)")
        pose = np.array(odom_T_vehicle, np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(
                "a scan's pose is not (4, 4) finite numbers: the octree needs odometry at every "
                "scan"
            )
        # The robot is in the middle of the cube.
        lowest_leaf = np.floor(pose[:3, 3] / self.leaf_m).astype(np.int64) - self.octree.side // 2

        # 1. Mark what the rays cross and hit.
        try:
            self._cast(points, pose, lowest_leaf)
        except BaseException:
            self.bricks.marks[:] = 0
            raise

        # 2. Follow the robot.
        is_gone = self._gone(lowest_leaf)
        if is_gone.any():
            forget(self.bricks, is_gone)

        # 3. Decay, and update.
        kept_share = self._kept_share(pose, variance)
        kernels.update_leaves(
            self.bricks,
            np.float32(kept_share),
            np.float32(KNOWN_FROM if kept_share < 1 else 0),
            hit_log_odds=self._hit_log_odds,
            miss_log_odds=self._miss_log_odds,
            min_log_odds=self._min_log_odds,
            max_log_odds=self._max_log_odds,
        )
        self.lowest_leaf = lowest_leaf
        self._odom_T_vehicle = pose

    def _cast(
        self,
        points: NDArray[np.float64],
        odom_T_vehicle: NDArray[np.float64],
        lowest_leaf: NDArray[np.int64],
    ) -> None:
        """Mark what the rays of a scan (n, 3) cross and hit in the cube at `lowest_leaf` (3,)."""
        octree = self.octree
        # The kernel's frame: lengths in leaves, from the cube's lowest corner.
        leaves_T_vehicle = odom_T_vehicle / self.leaf_m
        leaves_T_vehicle[:3, 3] -= lowest_leaf
        origin = (
            leaves_T_vehicle[:3, :3] @ (0.0, 0.0, octree.sensor_height_m) + leaves_T_vehicle[:3, 3]
        )
        slots = kernels.slot_count(len(points))
        if len(self._unhit_cells) < slots:
            self._unhit_cells = np.empty(slots, np.int64)
        unhit_cells = self._unhit_cells[:slots]
        unhit_cells[:] = kernels.VACANT
        # The kernel returns early when it runs out of bricks.
        bricks_per_ray = bricks_of_a_ray(self.bricks)
        first = 0
        while first < len(points):
            self.bricks = with_room(self.bricks, bricks_per_ray)
            first = int(
                kernels.cast(
                    points,
                    first,
                    leaves_T_vehicle,
                    origin,
                    lowest_leaf,
                    side=octree.side,
                    longest=octree.reach_m / self.leaf_m,
                    every_ray=octree.rays == "all",
                    bricks=self.bricks,
                    bricks_per_ray=bricks_per_ray,
                    unhit_cells=unhit_cells,
                )
            )
            if first < 0:
                raise InputError(
                    "a point is NaN, infinite or hundreds of kilometres away: drop such points "
                    "first"
                )

    def _kept_share(self, odom_T_vehicle: NDArray[np.float64], variance: Variance | None) -> float:
        """The factor by which the motion since the last scan multiplies all log-odds."""
        if self._odom_T_vehicle is None:
            return 1.0
        before = self._odom_T_vehicle
        after = odom_T_vehicle
        turn = before[:3, :3].T @ after[:3, :3]
        moved_m = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
        return self.octree.kept_share(moved_m, math.atan2(turn[1, 0], turn[0, 0]), variance)

    def _gone(self, lowest_leaf: NDArray[np.int64]) -> NDArray[np.bool_]:
        """The coordinates (3, side of the torus) that leave the cube when it moves to
        `lowest_leaf` (3,)."""
        torus = 1 << self.bricks.levels
        before = self.lowest_leaf[:, None] + (np.arange(torus) - self.lowest_leaf[:, None]) % torus
        return (before < lowest_leaf[:, None]) | (before >= lowest_leaf[:, None] + self.octree.side)


def log_odds(probability: float) -> float:
    """The log-odds log(P / (1 − P)) of a probability P."""
    return math.log(probability / (1 - probability))
