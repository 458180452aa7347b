"""Writes small bags with known content for the tests, of all three kinds."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.frames import pose
from pipeline.formats.bag import BagWriter

KINDS = ("ros1", "sqlite3", "mcap")
START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
BODY_T_LIDAR = pose(np.array([[0.5, 0.0, 1.5]]), np.array([[0.0, 0.0, np.pi / 2]]))[0]
"""The LiDAR is 0.5 m ahead and 1.5 m up in the body, and turned to the left."""


def at(x_m: float, yaw_rad: float = 0.0) -> np.ndarray:
    """A pose (4, 4) on the x axis."""
    return pose(np.array([[x_m, 0.0, 0.0]]), np.array([[0.0, 0.0, yaw_rad]]))[0]


def bag_path(root: Path, kind: str, name: str = "drive") -> Path:
    """The path of a bag of this kind: a file for `ros1`, else a folder."""
    return root / (f"{name}.bag" if kind == "ros1" else name)


def cloud(bag: BagWriter, stamp_ns: int, frame: str, points_m: Any, **details: Any) -> None:
    """Write a cloud (n, 3) of one intensity and ring; `details` are those of BagWriter.points."""
    points = np.asarray(points_m, np.float32)
    bag.points(stamp_ns, frame, points, np.ones(len(points)), np.zeros(len(points), int), **details)


def drive(path: Path, kind: str, clouds: int = 4, first: int = 0) -> Path:
    """Write a bag at `path` with the drive of `fill`."""
    with BagWriter(path, kind) as bag:
        fill(bag, clouds, first)
    return path


def fill(bag: BagWriter, clouds: int = 4, first: int = 0) -> None:
    """Write a drive along x at 10 m/s, with the clouds numbered from `first`.

    There are ten poses a second on /ground_truth, from 0 m, and on /odom, from 100 m, and a cloud
    50 ms after each but the last. Cloud i holds the points (i, 0, 0) and (1, 2, 3) in the LiDAR's
    frame.
    """
    bag.static_transform(START_NS, "base_link", "lidar", BODY_T_LIDAR)
    for i in range(first, first + clouds + 1):
        stamp_ns = START_NS + i * STEP_NS
        bag.odometry(stamp_ns, "map", "base_link", at(i), "/ground_truth")
        bag.odometry(stamp_ns, "odom", "base_link", at(100 + i), "/odom")
        if i < first + clouds:
            cloud(bag, stamp_ns + STEP_NS // 2, "lidar", [[i, 0, 0], [1, 2, 3]])
