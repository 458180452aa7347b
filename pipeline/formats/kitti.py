"""KITTI odometry's byte layouts (METHODS 7.3)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

RECORD_BYTES = 16


def scan_folder(root: Path, log: str) -> Path:
    return root / "sequences" / log / "velodyne"


def times_path(root: Path, log: str) -> Path:
    return root / "sequences" / log / "times.txt"


def calib_path(root: Path, log: str) -> Path:
    return root / "sequences" / log / "calib.txt"


def poses_path(root: Path, log: str) -> Path:
    return root / "poses" / f"{log}.txt"


def matrix(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """4×4 poses (n, 4, 4) from rows (n, 12), each a 3×4 matrix row by row."""
    poses = np.tile(np.eye(4), (len(numbers), 1, 1))
    poses[:, :3] = numbers.reshape(-1, 3, 4)
    return poses
