"""Bird-views (Yin et al., IROS 2018; METHODS 4.4 and 5.4): an octree and the robot's pose in,
images seen from above out.

1. Find the ground under the robot in its newest scan, and stand the robot upright on it.
2. Mark the columns of the octree that hold an occupied leaf in a band of heights above the ground.
3. Draw the square around the robot, heading up, at headings all around. The map is turned before it
   is drawn, never the image.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, NotNegative, Range, Seed, Side, check
from pipeline.mapping.bricks import BRICK, LEAVES, Bricks, corner
from pipeline.mapping.ground import find_plane
from pipeline.mapping.octree import Octree, OctreeMap, log_odds

NEAR_M = 0.2
"""A point nearer than this to the ground's plane supports it."""
STEEPEST_DEG = 20.0
"""A steeper plane is not the ground."""
PLANES = 200
"""Number of planes tried at most."""
POINTS = 4096
"""Number of a scan's points in which the ground is looked for, at most."""
SAMPLES = 4
"""A pixel is the mean of SAMPLES × SAMPLES samples of the columns."""
OCCUPIED = Range(0.5, 1 - 1e-9, wording="a probability of at least 0.5, which is unknown")
"""Probabilities from which a leaf may be taken for occupied."""


@dataclass(frozen=True)
class BirdView:
    """The settings of the images; each shows the whole width of the octree's cube."""

    schema: ClassVar[type[schemas.Views]] = schemas.BirdViews
    octree: Octree = field(default_factory=Octree)
    """The map's settings; a mapping of its fields is taken too."""
    low_m: float = 0.3
    """Height of the band's lower end above the ground: a leaf counts if its middle is in the band.
    The ground is below it."""
    high_m: float = 5.0
    """Height of the band's upper end above the ground."""
    upright: Literal["ground", "vehicle", "odometry"] = "ground"
    """The axis along which heights are measured. `ground` is the normal of the ground in the newest
    scan, which must be a 3-D one; `vehicle` is the vehicle's z axis, which pitches; `odometry` is
    odometry's, against which the ground slopes."""
    occupied: Annotated[float, OCCUPIED] = 0.6
    """A column is occupied if a leaf in the band has a higher probability than this."""
    headings: Count = 16
    """Number of headings. The even ones are references; the odd ones lie halfway between them and
    are queries of paper 2's protocol."""
    side_px: Side = 64
    """Width of an image."""
    jitter_m: NotNegative = 0.5
    """Standard deviation, on each axis, of the shift of the odd headings (METHODS 5.5)."""
    seed: Seed = 0
    """Seeds this shift, together with the submap's number."""

    def __post_init__(self) -> None:
        if isinstance(self.octree, Mapping):
            octree_fields = dict(self.octree)
            octree_fields.pop("_target_", None)  # hydra's key for the class, in a yaml
            object.__setattr__(self, "octree", Octree(**octree_fields))
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

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Draw the images of a map of the points (n, 3) alone, z up from the ground.

        Raises InputError like `OctreeMap.insert`.
        """
        octree_map = self.octree.grow()
        octree_map.insert(points_m, np.eye(4))
        return self.draw(octree_map, self.standing(points_m, np.eye(4)))

    def standing(
        self, points_m: NDArray[np.floating], odom_T_vehicle: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The pose (4, 4) in odometry of a robot that stands as `upright` says; see `draw`.

        With `ground`, its origin also lies on the ground that `points_m` (n, 3) show, the newest
        scan in the vehicle's frame. If they show none, the pose is the vehicle's.
        """
        vehicle_T_robot = np.eye(4)
        if self.upright == "odometry":
            odom_R_upright = upright(odom_T_vehicle[:3, 0], np.array([0.0, 0.0, 1.0]))
            vehicle_T_robot[:3, :3] = odom_T_vehicle[:3, :3].T @ odom_R_upright
        elif self.upright == "ground":
            is_near = np.hypot(points_m[:, 0], points_m[:, 1]) < self.octree.edge_m / 2
            near_points = points_m[is_near].astype(np.float64)
            stride = max(math.ceil(len(near_points) / POINTS), 1)
            ground_plane = find_plane(
                near_points[::stride],
                NEAR_M,
                STEEPEST_DEG,
                PLANES,
                np.random.default_rng(self.seed),
            )
            if ground_plane:
                # The plane is a x + b y + z = height_m, so (a, b, 1) is its normal.
                a, b, height_m = ground_plane
                vehicle_T_robot[:3, :3] = upright(np.array([1.0, 0.0, 0.0]), np.array([a, b, 1.0]))
                vehicle_T_robot[2, 3] = height_m
        return np.asarray(odom_T_vehicle @ vehicle_T_robot)

    def draw(
        self, octree_map: OctreeMap, odom_T_robot: NDArray[np.float64], number: int = 0
    ) -> NDArray[np.uint8]:
        """Draw the images (headings, side_px, side_px) around a robot at its pose by `standing`.

        A pixel is the share of its area that is occupied, from 0 to 255. Pixel row 0 is the front,
        pixel column 0 the left. Image h is what the robot would see if it were turned
        h · 360° / headings further to the left; a quarter turn is exactly np.rot90(image, −1). The
        odd headings are drawn around a point beside the robot, moved by `offset_m` of the submap's
        `number`.
        """
        is_occupied = self.columns(octree_map, odom_T_robot)
        yaw_rad = math.atan2(odom_T_robot[1, 0], odom_T_robot[0, 0])
        c = math.cos(yaw_rad)
        s = math.sin(yaw_rad)
        forward_m, left_m = self.offset_m(number)
        odom_offset_m = np.array([c * forward_m - s * left_m, s * forward_m + c * left_m])
        robot = (odom_T_robot[:2, 3] - octree_map.corner_m[:2]) / octree_map.leaf_m
        beside_robot = robot + odom_offset_m / octree_map.leaf_m
        images = np.empty((self.headings, self.side_px, self.side_px), np.uint8)
        # There are a multiple of 8 headings, so a quarter of them is even: an odd h stays odd, and
        # all four quarter turns of an image have the same middle.
        quarter = self.headings // 4
        for h in range(quarter):
            heading_rad = yaw_rad + 2 * math.pi * h / self.headings
            middle = beside_robot if h % 2 else robot
            images[h] = _sampled(
                is_occupied, middle, heading_rad, float(self.octree.side), self.side_px, SAMPLES
            )
            for turns in range(1, 4):
                images[h + turns * quarter] = np.rot90(images[h], -turns)
        return images

    def columns(
        self, octree_map: OctreeMap, odom_T_robot: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """1 where a column of leaves (side, side), x-major, is occupied in the band, else 0."""
        leaf_m = octree_map.leaf_m
        up = self.up(odom_T_robot)
        ground = (odom_T_robot[:3, 3] - octree_map.corner_m) / leaf_m
        return np.asarray(
            _occupied_columns(
                octree_map.bricks,
                octree_map.lowest_leaf,
                self.octree.side,
                ground,
                up,
                low=self.low_m / leaf_m,
                high=self.high_m / leaf_m,
                threshold=log_odds(self.occupied),
            )
        )

    def up(self, odom_T_robot: NDArray[np.float64]) -> NDArray[np.float64]:
        """The robot's z axis (3,) in odometry, along which heights are measured.

        Raises InputError for a robot that lies on its side.
        """
        up = np.array(odom_T_robot[:3, 2], np.float64)
        if not up[2] > 0.5:
            raise InputError(
                "the robot is tilted by more than 60° against odometry's z axis: no bird's-eye view"
            )
        return up

    def offset_m(self, number: int) -> NDArray[np.float64]:
        """The random shift (2,) of a submap's odd headings, forward and to the left."""
        return np.random.default_rng((self.seed, number)).normal(0.0, 1.0, 2) * self.jitter_m


def upright(forward: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) with z along `up` (3,) and x as near to `forward` (3,) as possible."""
    z = up / np.linalg.norm(up)
    x = forward - (forward @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


@njit(cache=True, nogil=True, error_model="numpy")
def _occupied_columns(
    bricks: Bricks,
    lowest_leaf: NDArray[np.int64],
    side: int,
    ground: NDArray[np.float64],
    up: NDArray[np.float64],
    low: float,
    high: float,
    threshold: float,
) -> NDArray[np.uint8]:
    """1 where a column (side, side) has a leaf above the threshold in the band of heights."""
    is_occupied = np.zeros((side, side), np.uint8)
    mask = (1 << bricks.levels) - 1  # coordinates wrap around the torus of 2^levels leaves
    for brick in range(bricks.used[0]):
        corner_x, corner_y, corner_z = corner(bricks, brick)
        for column in range(BRICK * BRICK):
            first_leaf = brick * LEAVES + column * BRICK
            leaves = bricks.log_odds[first_leaf : first_leaf + BRICK]
            highest = leaves[0]
            for z in range(1, BRICK):
                highest = max(highest, leaves[z])
            if highest > threshold:
                # Find the z of the leaf at which the ground crosses this column: its middle is on
                # the ground if (middle − ground) · up = 0, which is solved for z. Along z, the
                # band's heights are longer by the slope.
                x = (corner_x + column // BRICK - lowest_leaf[0]) & mask
                y = (corner_y + column % BRICK - lowest_leaf[1]) & mask
                ground_z = (
                    ground[2]
                    - 0.5
                    - ((x + 0.5 - ground[0]) * up[0] + (y + 0.5 - ground[1]) * up[1]) / up[2]
                )
                start = math.ceil(ground_z + low / up[2])
                stop = math.ceil(ground_z + high / up[2])
                for z in range(BRICK):
                    if (
                        leaves[z] > threshold
                        and start <= (corner_z + z - lowest_leaf[2]) & mask < stop
                    ):
                        is_occupied[x, y] = 1
    return is_occupied


@njit(cache=True, nogil=True, error_model="numpy")
def _sampled(
    is_occupied: NDArray[np.uint8],
    middle: NDArray[np.float64],
    yaw_rad: float,
    width: float,
    side_px: int,
    samples: int,
) -> NDArray[np.uint8]:
    """Draw a square of the map as an image (side_px, side_px): row 0 front, column 0 left."""
    image = np.empty((side_px, side_px), np.uint8)
    side = is_occupied.shape[0]
    step = width / (side_px * samples)
    front_x = math.cos(yaw_rad) * step
    front_y = math.sin(yaw_rad) * step
    points = samples * samples
    edge = 0.5 * (side_px * samples - 1)  # the outermost samples, in steps from the middle
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
                        count += is_occupied[x, y]
            image[row, col] = (510 * count + points) // (2 * points)  # 255 count / points, rounded
    return image
