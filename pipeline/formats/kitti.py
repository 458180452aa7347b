"""Encodes and decodes the files of KITTI odometry (METHODS 7.3).

The reader uses it, and the simulated world that writes its logs as KITTI does. A scan is in the
Velodyne's frame, x forward, y left, z up; poses are of camera 0, x right, y down, z forward.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

RECORD_BYTES = 16
"""Bytes of a point: x, y, z, reflectance as 32-bit floats."""
SCANS = "sequences/{log}/velodyne"
TIMES = "sequences/{log}/times.txt"
CALIB = "sequences/{log}/calib.txt"
POSES = "poses/{log}.txt"
"""The files of a log below the root, as templates."""
CAM_T_VELO = np.array(
    [
        [0.0, -1.0, 0.0, -0.012],
        [0.0, 0.0, -1.0, -0.054],
        [1.0, 0.0, 0.0, -0.292],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""Calibration of the simulated car.

cam0 is 29 cm ahead of the lidar, 5 cm below it and 1 cm to its right, and is not turned.
"""
FOCAL_PX = 718.856
CENTRE_PX = (607.1928, 185.2157)
PROJECTION_OFFSETS_PX_M = (0.0, -386.1448, 45.38225, -337.2877)
"""Focal length, centre and last column of the projections P0 to P3 in log 00.

The last column (px · m) is −focal length × distance of the camera to the right of cam0.
"""


def to_poses(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from rows (n, 12), each of which is a 3×4 matrix row by row."""
    poses = np.tile(np.eye(4), (len(numbers), 1, 1))
    poses[:, :3] = numbers.reshape(-1, 3, 4)
    return poses


@njit(cache=True, nogil=True, error_model="numpy")
def decode(numbers: NDArray[np.float32], lift_m: float = 0.0) -> NDArray[np.float64]:
    """The finite points (k, 3) of a scan in metres, raised by `lift_m`.

    `numbers` (4 n,) are the records one after the other.
    """
    points = np.empty((numbers.shape[0] // 4, 3), np.float64)
    count = 0
    metres = points.reshape(-1)
    for i in range(numbers.shape[0] // 4):
        x = np.float64(numbers[4 * i])
        y = np.float64(numbers[4 * i + 1])
        z = np.float64(numbers[4 * i + 2])
        metres[3 * count] = x + 0.0  # makes 0 of −0, whose atan2 differs
        metres[3 * count + 1] = y + 0.0
        metres[3 * count + 2] = z + lift_m
        count += np.isfinite(x + y + z)  # else the next point is written over this one
    return points[:count]


def encode(points_m: NDArray[np.floating], reflectance: NDArray[np.floating]) -> bytes:
    """A scan's bytes: `points_m` (n, 3) in the Velodyne's frame, `reflectance` (n,) from 0 to 1."""
    return np.column_stack([points_m, reflectance]).astype("<f4").tobytes()


def write_calib(path: Path) -> None:
    """Write calib.txt: P0 to P3, the rectified cameras' projections, and Tr = cam0 <- velodyne."""
    matrices: dict[str, NDArray[np.float64]] = {}
    for camera, offset in enumerate(PROJECTION_OFFSETS_PX_M):
        matrices[f"P{camera}"] = np.array(
            [[FOCAL_PX, 0, CENTRE_PX[0], offset], [0, FOCAL_PX, CENTRE_PX[1], 0], [0, 0, 1, 0]]
        )
    matrices["Tr"] = CAM_T_VELO[:3]
    write_lines(path, [f"{name}: {_numbers(matrix)}" for name, matrix in matrices.items()])


def write_times(path: Path, times_s: NDArray[np.float64]) -> None:
    """Write times.txt: seconds (n,) from the first scan on."""
    write_lines(path, [f"{time:.6e}" for time in times_s.tolist()])


def write_poses(path: Path, first_T_cam: NDArray[np.float64]) -> None:
    """Write a pose file: poses (n, 4, 4) of cam0 in its first frame."""
    write_lines(path, [_numbers(pose[:3]) for pose in first_T_cam])


def _numbers(matrix: NDArray[np.float64]) -> str:
    """The numbers of a matrix as text, row by row."""
    return " ".join(f"{number:.12e}" for number in matrix.ravel().tolist())


def write_lines(path: Path, lines: Sequence[str]) -> None:
    """Write a text file, and the folder that it is in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
