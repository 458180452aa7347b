"""A drive round a block: a circle of 16 m radius, 1.3 times, among houses all around."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.readers.log import Log
from pipeline.slam.drive import Slam
from pipeline.slam.odometry import ScanOdometry

RADIUS_M = 16.0
STEP_M = 1.0
STEP_NS = 500_000_000
ROUND = 100
"""Scans to a whole round: 2π · 16 m is 100.5 m."""
QUICK = Slam(odometry=ScanOdometry(trials=2))
"""Tries all guesses at the first two steps only, not at ten: they take most of the time of a short
drive."""


def houses(seed: int = 0, count: int = 20) -> NDArray[np.float64]:
    """Points (n, 3) of a ground of 120 m and the walls of houses beside the circle."""
    rng = np.random.default_rng(seed)
    parts = [np.column_stack([rng.uniform(-60, 60, (6000, 2)), rng.normal(0, 0.02, 6000)])]
    for _ in range(count):
        away_m = rng.choice([rng.uniform(3, 10), rng.uniform(23, 50)])
        bearing = rng.uniform(0, 2 * np.pi)
        width_m = rng.uniform(2, 9)
        turn = rng.uniform(0, np.pi)
        along_m = rng.uniform(-width_m / 2, width_m / 2, 700)
        across_m = rng.choice([-1.5, 1.5], 700)
        turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        centre_m = away_m * np.array([np.cos(bearing), np.sin(bearing)])
        xy_m = np.column_stack([along_m, across_m]) @ turned + centre_m
        parts.append(np.column_stack([xy_m, rng.uniform(0, rng.uniform(3, 9), 700)]))
    return np.concatenate(parts)


def circle(count: int) -> NDArray[np.float64]:
    """Poses (n, 4, 4) on the circle, counter-clockwise, a metre apart."""
    angle = np.arange(count) * STEP_M / RADIUS_M
    xyz_m = np.column_stack([RADIUS_M * np.sin(angle), -RADIUS_M * np.cos(angle), 0 * angle])
    return pose(xyz_m, np.column_stack([0 * angle, 0 * angle, angle]))


def drive(
    world_T_scan: NDArray[np.float64],
    odom_T_scan: NDArray[np.float64] | None = None,
    seed: int = 0,
    range_m: float = 40.0,
) -> Log:
    """The log of a robot that sees a random half of the points within range at each pose."""
    world_m = houses(seed)
    count = len(world_T_scan)

    def points(row: int) -> NDArray[np.float64]:
        scan_T_world = np.linalg.inv(world_T_scan[row])
        points_m = world_m @ scan_T_world[:3, :3].T + scan_T_world[:3, 3]
        seen = np.random.default_rng(row).random(len(points_m)) < 0.5
        return points_m[seen & (np.linalg.norm(points_m, axis=1) < range_m)]

    return Log(
        np.arange(1, count + 1) * STEP_NS,
        np.full((count, 4, 4), np.nan),
        np.full((count, 4, 4), np.nan) if odom_T_scan is None else odom_T_scan,
        points,
        Counter(),
    )
