"""Bird-views: the occupied leaves of the dynamic octree around the robot, seen from above, at
headings all around.

Yin et al., IROS 2018; METHODS 4.4 and 5.4. The map is turned before it is drawn, never the image.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, NotNegative, Seed, Side, check
from pipeline.mapping.bricks import BRICK, LEAVES, Bricks, corner
from pipeline.mapping.ground import plane
from pipeline.mapping.octree import Octree, OctreeMap, log_odds

NEAR_M = 0.2
STEEPEST_DEG = 20.0
PLANES = 200
POINTS = 4096
"""RANSAC of the ground's plane: inlier distance, largest slope, planes tried, and points of a scan
used at most."""
SAMPLES = 4
"""A pixel is the mean of SAMPLES × SAMPLES points in it."""


@dataclass(frozen=True)
class BirdView:
    """Settings of the images of an octree, or of a submap's points alone; an image shows the whole
    width of the root cube."""

    schema: ClassVar[type[schemas.Views]] = schemas.BirdViews
    octree: Octree = field(default_factory=Octree)
    """As an Octree, or a mapping of its fields."""
    low_m: float = 0.3
    high_m: float = 5.0
    """Leaves whose middle is from `low_m` to `high_m` above the ground under the robot count: no
    ground, few moving things."""
    upright: Literal["ground", "vehicle", "odometry"] = "ground"
    """The axis that heights are measured along: the normal of the ground plane in the newest scan,
    which must be a 3-D one; the vehicle's z axis, which pitches; or odometry's, in which the ground
    slopes."""
    occupied: float = 0.6
    """A column is occupied if one of these leaves is with a higher probability."""
    headings: Count = 16
    """The even ones are references; the odd ones lie halfway between and are queries."""
    side_px: Side = 64
    jitter_m: NotNegative = 0.5
    """Standard deviation, on each axis, of a shift of the odd ones: METHODS 5.5's slight
    translation."""
    seed: Seed = 0
    """Of that shift, together with each submap's number."""

    def __post_init__(self) -> None:
        if isinstance(self.octree, Mapping):
            object.__setattr__(
                self,
                "octree",
                Octree(**{name: self.octree[name] for name in self.octree if name != "_target_"}),
            )
        check(self, "view")
        if self.headings < 8 or self.headings % 8:
            raise ConfigError(
                f"view.headings={self.headings}: expected a multiple of 8, half references and "
                "half queries"
            )
        if not self.low_m < self.high_m:
            raise ConfigError(
                f"view.low_m={self.low_m}, high_m={self.high_m}: expected a band of heights"
            )
        if not 0.5 <= self.occupied < 1:
            raise ConfigError(
                f"view.occupied={self.occupied}: expected a probability of at least 0.5, which is "
                "unknown"
            )

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.uint8]:
        """The images of a map grown from points (n, 3) alone, z up from the ground.

        Raises InputError as `OctreeMap.insert`.
        """
        grown = self.octree.grow()
        grown.insert(points_m, np.eye(4))
        return self.draw(grown, self.standing(points_m, np.eye(4)))

    def standing(
        self, points_m: NDArray[np.floating], odom_T_vehicle: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The robot's pose (4, 4) with its z axis as `upright` says.

        Where that is the ground's, its origin lies on the ground. `points_m` (n, 3) is the newest
        scan, in the vehicle's frame. Where it shows no ground the pose is the vehicle's.
        """
        vehicle_T_ground = np.eye(4)
        if self.upright == "odometry":
            vehicle_T_ground[:3, :3] = odom_T_vehicle[:3, :3].T @ upright(
                odom_T_vehicle[:3, 0], np.array([0.0, 0.0, 1.0])
            )
        elif self.upright == "ground":
            near_points = points_m[
                np.hypot(points_m[:, 0], points_m[:, 1]) < self.octree.edge_m / 2
            ].astype(np.float64)
            near_points = near_points[:: -(-len(near_points) // POINTS) or 1]
            if ground_plane := plane(
                near_points, NEAR_M, STEEPEST_DEG, PLANES, np.random.default_rng(self.seed)
            ):
                a, b, height_m = ground_plane
                vehicle_T_ground[:3, :3] = upright(np.array([1.0, 0.0, 0.0]), np.array([a, b, 1.0]))
                vehicle_T_ground[2, 3] = height_m
        pose: NDArray[np.float64] = odom_T_vehicle @ vehicle_T_ground
        return pose

    def draw(
        self, grown: OctreeMap, odom_T_vehicle: NDArray[np.float64], number: int = 0
    ) -> NDArray[np.uint8]:
        """Images (headings, side_px, side_px) around a robot `standing` at (4, 4), 255 where all of
        a pixel is occupied.

        Row 0 is the front, column 0 the left. Image h is what the robot would see if it were turned
        h · 360° / headings further to the left; a quarter turn is exactly np.rot90(image, −1). The
        odd headings of submap `number` stand `offset_m` off.
        """
        columns = self.columns(grown, odom_T_vehicle)
        yaw_rad = math.atan2(odom_T_vehicle[1, 0], odom_T_vehicle[0, 0])
        c = math.cos(yaw_rad)
        s = math.sin(yaw_rad)
        forward_m, left_m = self.offset_m(number)
        robot = (odom_T_vehicle[:2, 3] - grown.corner_m[:2]) / grown.leaf_m
        beside_robot = (
            robot
            + np.array([c * forward_m - s * left_m, s * forward_m + c * left_m]) / grown.leaf_m
        )
        images = np.empty((self.headings, self.side_px, self.side_px), np.uint8)
        quarter = self.headings // 4
        for h in range(quarter):
            turned_rad = yaw_rad + 2 * math.pi * h / self.headings
            middle = beside_robot if h % 2 else robot
            images[h] = _sampled(
                columns, middle, turned_rad, float(self.octree.side), self.side_px, SAMPLES
            )
            for turns in range(1, 4):
                images[h + turns * quarter] = np.rot90(images[h], -turns)
        return images

    def columns(self, grown: OctreeMap, odom_T_vehicle: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Which of the map's columns (side, side), x-major, are occupied in the band above the
        ground: 1 or 0."""
        leaf_m = grown.leaf_m
        up = self.up(odom_T_vehicle)
        ground = (odom_T_vehicle[:3, 3] - grown.corner_m) / leaf_m
        band = self.low_m / leaf_m, self.high_m / leaf_m
        columns: NDArray[np.uint8] = _columns_above(
            grown.bricks, grown.lowest, self.octree.side, ground, up, *band, log_odds(self.occupied)
        )
        return columns

    def up(self, odom_T_vehicle: NDArray[np.float64]) -> NDArray[np.float64]:
        """The normal (3,) of the ground, in odometry's frame.

        Raises InputError for a robot that lies on its side.
        """
        up = np.array(odom_T_vehicle[:3, 2], np.float64)
        if not up[2] > 0.5:
            raise InputError(
                "the robot is tilted by more than 60° against odometry's z axis: no bird's-eye view"
            )
        return up

    def offset_m(self, number: int) -> NDArray[np.float64]:
        """Shift forward and to the left (2,) of a submap's odd headings."""
        return np.random.default_rng((self.seed, number)).normal(0.0, 1.0, 2) * self.jitter_m


def upright(forward: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) whose z axis is along `up` (3,) and whose x axis looks as near to
    `forward` (3,) as it can."""
    z = up / np.linalg.norm(up)
    x = forward - (forward @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _columns_above(
    bricks: Bricks,
    lowest: NDArray[np.int64],
    side: int,
    ground: NDArray[np.float64],
    up: NDArray[np.float64],
    low: float,
    high: float,
    threshold: float,
) -> NDArray[np.uint8]:
    """Whether any leaf of a column (side, side) whose middle is from `low` to below `high` above
    the ground exceeds a threshold.

    Lengths are in leaves. The ground is the plane through `ground` (3,) with the upward normal `up`
    (3,), from the root cube's corner, which is the leaf `lowest` (3,) of odometry.
    """
    occupied = np.zeros((side, side), np.uint8)
    mask = (1 << bricks.levels) - 1
    for brick in range(bricks.used[0]):
        corner_x, corner_y, corner_z = corner(bricks, brick)
        for column in range(BRICK * BRICK):
            leaves = bricks.log_odds[brick * LEAVES + column * BRICK :][:BRICK]
            highest = leaves[0]
            for z in range(1, BRICK):
                highest = max(highest, leaves[z])
            if highest > threshold:
                x = (corner_x + column // BRICK - lowest[0]) & mask
                y = (corner_y + column % BRICK - lowest[1]) & mask
                level = (
                    ground[2]
                    - 0.5
                    - ((x + 0.5 - ground[0]) * up[0] + (y + 0.5 - ground[1]) * up[1]) / up[2]
                )
                start = math.ceil(level + low / up[2])
                stop = math.ceil(level + high / up[2])
                for z in range(BRICK):
                    if leaves[z] > threshold and start <= (corner_z + z - lowest[2]) & mask < stop:
                        occupied[x, y] = 1
    return occupied


@njit(cache=True, nogil=True, error_model="numpy")
def _sampled(
    columns: NDArray[np.uint8],
    middle: NDArray[np.float64],
    yaw_rad: float,
    width: float,
    side_px: int,
    samples: int,
) -> NDArray[np.uint8]:
    """Each pixel's share of set columns, 0…255, in a heading-up image (side_px, side_px): row 0
    front, column 0 left.

    It shows the square of `width` columns around `middle` (2,), its front along `yaw_rad`; a pixel
    is the mean of samples × samples points.
    """
    image = np.empty((side_px, side_px), np.uint8)
    side = columns.shape[0]
    step = width / (side_px * samples)
    front_x = math.cos(yaw_rad) * step
    front_y = math.sin(yaw_rad) * step
    most = samples * samples
    edge = 0.5 * (side_px * samples - 1)
    for row in range(side_px):
        for col in range(side_px):
            count = 0
            for i in range(samples):
                front = edge - (row * samples + i)
                for j in range(samples):
                    left = edge - (col * samples + j)
                    x = math.floor(middle[0] + front * front_x - left * front_y)
                    y = math.floor(middle[1] + front * front_y + left * front_x)
                    if 0 <= x < side and 0 <= y < side:
                        count += columns[x, y]
            image[row, col] = (510 * count + most) // (2 * most)
    return image
