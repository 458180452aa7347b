"""A made town: the points of a 3-D map of houses and trees, and what a lidar in it would see."""

import numpy as np
from numpy.typing import NDArray

from tests.posing.scene import planar, seen_from

SENSOR_M = 1.8
"""Height of the lidar above the ground."""
REACH_M = 60.0
"""The lidar sees no farther."""


def town(seed: int = 0, side_m: float = 160.0) -> NDArray[np.float64]:
    """Points (n, 3) of a square from (0, 0) on: ground at z = 0, and a house in most blocks of
    20 m. The houses differ in size, turn, height and place."""
    rng = np.random.default_rng(seed)
    steps = np.arange(0.2, side_m, 0.4)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    parts = [np.column_stack([x.ravel(), y.ravel(), rng.normal(0, 0.02, x.size)])]
    for block_x in np.arange(0, side_m, 20):
        for block_y in np.arange(0, side_m, 20):
            middle_m = np.array([block_x, block_y]) + rng.uniform(6, 14, 2)
            if rng.random() < 0.7:
                parts.append(house(rng, middle_m))
            else:
                parts.append(tree(rng, middle_m))
    return np.concatenate(parts)


def house(rng: np.random.Generator, middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) of the walls of a house, 4 to 12 m long and wide and 3 to 9 m high."""
    size_m = rng.uniform(4, 12, 2)
    height_m = rng.uniform(3, 9)
    count = int(size_m.sum() * height_m * 12)
    along = rng.uniform(-0.5, 0.5, count)
    side = rng.integers(4, size=count)
    half = np.where(side % 2, 0.5, -0.5)
    walls = np.where(
        (side < 2)[:, None], np.column_stack([along, half]), np.column_stack([half, along])
    )
    z_m = rng.uniform(0, height_m, count)
    turn = planar(*middle_m, np.rad2deg(rng.uniform(0, np.pi)))
    level_m = np.column_stack([walls * size_m, z_m])
    return level_m @ turn[:3, :3].T + turn[:3, 3]


def tree(rng: np.random.Generator, middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) of a trunk and a crown."""
    trunk_m = np.column_stack([rng.normal(0, 0.2, (150, 2)), rng.uniform(0, 3, 150)])
    crown_m = rng.normal(0, 1.0, (400, 3)) + np.array([0.0, 0.0, 5.0])
    return np.concatenate([trunk_m, crown_m]) + np.append(middle_m, 0.0)


def scan(
    map_m: NDArray[np.float64], world_T_robot: NDArray[np.float64], reach_m: float = REACH_M
) -> NDArray[np.float64]:
    """The points (n, 3) of a map that a robot sees, in its frame: those not behind others."""
    points_m = seen_from(map_m, world_T_robot)
    points_m = points_m[np.hypot(points_m[:, 0], points_m[:, 1]) < reach_m]
    beam_m = points_m - [0.0, 0.0, SENSOR_M]
    away_m = np.linalg.norm(beam_m, axis=1)
    azimuth = np.floor(np.rad2deg(np.arctan2(beam_m[:, 1], beam_m[:, 0]))).astype(int)
    elevation = np.floor(np.rad2deg(np.arcsin(beam_m[:, 2] / away_m))).astype(int)
    direction = azimuth * 180 + elevation
    nearest_m = np.full(direction.max() - direction.min() + 1, np.inf)
    np.minimum.at(nearest_m, direction - direction.min(), away_m)
    return points_m[away_m < nearest_m[direction - direction.min()] + 0.5]
