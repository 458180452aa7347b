"""The dynamic octree: an occupancy map that moves with the robot and decays with its motion.

Dynamic octree mapping of Yin et al. (IROS 2018), on OctoMap's log-odds (Hornung et al., Autonomous
Robots 2013); METHODS 4. The leaves of the root cube are kept in bricks, allocated when a ray
touches them and freed when all is unknown again. OctoMap's inner nodes, the highest of their
children, are not kept: nothing reads them.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import NotNegative, Positive, check
from pipeline.mapping import octree_kernels as kernels
from pipeline.mapping.bricks import Bricks, bricks_of_a_ray, dense, empty, forget, with_room

Variance = tuple[float, float]
"""Of a motion: of its position in m² and of its turn in rad², both above 0."""
LEAST = 1e-3
"""A leaf whose log-odds decayed below this is unknown again."""


@dataclass(frozen=True)
class Octree:
    """How a map grows; the defaults are OctoMap's numbers at the IROS paper's scale for a car."""

    edge_m: Positive = 50.0
    """Of the root cube, whose middle is within a leaf of the robot."""
    depth: int = 7
    """Levels below the root: 2^depth leaves along an edge."""
    hit: float = 0.7
    """Probability that a leaf is occupied, after one scan with a point in it."""
    miss: float = 0.4
    """The same after one ray through it."""
    lowest: float = 0.1192
    highest: float = 0.971
    """Probabilities are clamped to these, so that a leaf can change its mind."""
    motion: Literal["gaussian", "per_metre", "none"] = "gaussian"
    """Decay of all log-odds by a motion u, in the deviations below: factor exp(−|u|²/2) a scan; or,
    independent of the scan rate, exp(−|u| sigma_m / per_metre_m); or none."""
    sigma: Literal["log", "constant"] = "constant"
    """Deviations of `gaussian`: what the log's odometry says of each motion (eq. 4 as written), or
    the two below; those also where the log says nothing. `per_metre` always takes those below."""
    sigma_m: Positive = 2.0
    sigma_rad: Positive = 0.5
    per_metre_m: Positive = 8.0
    """At a scan a metre both ways of decay agree."""
    rays: Literal["end_voxel", "all"] = "end_voxel"
    """One ray to the middle of each cell that holds points, as OctoMap discretises, or one to every
    point."""
    max_range_m: NotNegative = 0.0
    """From the sensor; beyond it a ray clears what it crosses and hits nothing. 0: half the root
    cube's diagonal."""
    sensor_height_m: float = 1.73
    """Rays start this far above the vehicle frame's origin."""

    def __post_init__(self) -> None:
        check(self, "view.octree")
        if not 2 <= self.depth <= 9:
            raise ConfigError(
                f"view.octree.depth={self.depth}: expected a whole number from 2 to 9"
            )
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
        """Edge of a leaf."""
        return self.edge_m / self.side

    @property
    def reach_m(self) -> float:
        """The longest ray that hits."""
        return self.max_range_m or math.sqrt(3) / 2 * self.edge_m

    def kept(self, moved_m: float, turned_rad: float, variance: Variance | None = None) -> float:
        """The share of all log-odds that is left after a motion (METHODS 4.3): 1 at rest.

        `variance` is what the log says of this motion.
        """
        deviations = math.hypot(moved_m / self.sigma_m, turned_rad / self.sigma_rad)
        if self.motion == "gaussian":
            if self.sigma == "log" and variance is not None:
                deviations = math.hypot(
                    moved_m / math.sqrt(variance[0]), turned_rad / math.sqrt(variance[1])
                )
            return math.exp(-0.5 * deviations**2)
        return (
            math.exp(-deviations * self.sigma_m / self.per_metre_m)
            if self.motion == "per_metre"
            else 1.0
        )

    def grow(self) -> "OctreeMap":
        """An empty map."""
        return OctreeMap(self)


class OctreeMap:
    """One sequence's map, its axes those of the odometry.

    Cells lie at whole multiples of `leaf_m` there.
    """

    bricks: Bricks
    """The known leaves."""
    lowest: NDArray[np.int64]
    """The lowest leaf (3,) of the root cube, counted from odometry's origin."""

    def __init__(self, octree: Octree) -> None:
        self.octree = octree
        self.lowest = np.zeros(3, np.int64)
        self.bricks = empty(octree.side)
        self._seen = np.empty(0, np.int64)
        self._odom_T_vehicle: NDArray[np.float64] | None = None
        L = [
            np.float32(log_odds(p))
            for p in (octree.hit, octree.miss, octree.lowest, octree.highest)
        ]
        self._numbers = L[0], L[1], L[2], L[3]

    @property
    def leaf_m(self) -> float:
        """Edge of a leaf."""
        return self.octree.leaf_m

    @property
    def corner_m(self) -> NDArray[np.float64]:
        """The lowest corner (3,) of the root cube, in odometry's frame."""
        return np.asarray(self.lowest * self.leaf_m, np.float64)

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """A copy (side, side, side) of all leaves, x-major; 0 is unknown."""
        return dense(self.bricks, self.lowest, self.octree.side)

    def insert(
        self,
        points_m: NDArray[np.floating],
        odom_T_vehicle: NDArray[np.float64],
        variance: Variance | None = None,
    ) -> None:
        """Add a scan (n, 3) of the vehicle frame at `odom_T_vehicle` (4, 4): METHODS 4.4.

        `variance` is what the log says of the motion since the last scan, None if nothing.

        All log-odds decay by the motion since the last scan, the root cube follows by whole leaves,
        then each leaf that rays of the scan cross misses once and each that holds a point hits
        once. Raises InputError for a wrong shape, or a pose or point that is not finite; the map is
        then as before.
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
        lowest = np.floor(pose[:3, 3] / self.leaf_m).astype(np.int64) - self.octree.side // 2
        try:
            self._cast(points, pose, lowest)
        except BaseException:
            self.bricks.marks[:] = 0
            raise
        if (is_gone := self._gone(lowest)).any():
            forget(self.bricks, is_gone)
        kept_share = self._kept(pose, variance)
        kernels.sweep(
            self.bricks,
            np.float32(kept_share),
            np.float32(LEAST if kept_share < 1 else 0),
            *self._numbers,
        )
        self.lowest = lowest
        self._odom_T_vehicle = pose

    def _cast(
        self,
        points: NDArray[np.float64],
        odom_T_vehicle: NDArray[np.float64],
        lowest: NDArray[np.int64],
    ) -> None:
        """Mark what the rays of a scan (n, 3) cross and hit in the root cube at `lowest` (3,)."""
        octree = self.octree
        leaves_T_vehicle = odom_T_vehicle / self.leaf_m
        leaves_T_vehicle[:3, 3] -= lowest
        origin = (
            leaves_T_vehicle[:3, :3] @ (0.0, 0.0, octree.sensor_height_m) + leaves_T_vehicle[:3, 3]
        )
        rays = octree.side, octree.reach_m / self.leaf_m, octree.rays == "all"
        slots = kernels.room(len(points))
        most = bricks_of_a_ray(self.bricks)
        points_done = 0
        self._seen = self._seen if len(self._seen) >= slots else np.empty(slots, np.int64)
        seen = self._seen[:slots]
        seen[:] = kernels.VACANT
        while points_done < len(points):
            self.bricks = with_room(self.bricks, most)
            points_done = int(
                kernels.cast(
                    points,
                    points_done,
                    leaves_T_vehicle,
                    origin,
                    lowest,
                    *rays,
                    self.bricks,
                    most,
                    seen,
                )
            )
            if points_done < 0:
                raise InputError(
                    "a point is NaN, infinite or hundreds of kilometres away: drop such points "
                    "first"
                )

    def _kept(self, odom_T_vehicle: NDArray[np.float64], variance: Variance | None) -> float:
        """The share of all log-odds that is left on the way from the last scan."""
        if self._odom_T_vehicle is None:
            return 1.0
        before = self._odom_T_vehicle
        after = odom_T_vehicle
        turn = before[:3, :3].T @ after[:3, :3]
        moved_m = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
        return self.octree.kept(moved_m, math.atan2(turn[1, 0], turn[0, 0]), variance)

    def _gone(self, lowest: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which torus coordinates (3, torus) the cube leaves when it moves to `lowest` (3,)."""
        torus = 1 << self.bricks.levels
        before = self.lowest[:, None] + (np.arange(torus) - self.lowest[:, None]) % torus
        return (before < lowest[:, None]) | (before >= lowest[:, None] + self.octree.side)


def log_odds(probability: float) -> float:
    """log(P / (1 − P))."""
    return math.log(probability / (1 - probability))
