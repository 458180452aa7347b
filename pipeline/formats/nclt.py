"""Encodes and decodes the files of NCLT (METHODS 7.1).

The reader uses it, and the simulated world that writes its logs as NCLT does. In the files scans
are in the body frame x forward, y right, z down, with the ground near z = 0; poses are
north-east-down.
"""

from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

GRAIN_M = 0.005
OFFSET_M = -100.0
"""A coordinate is OFFSET_M plus a whole number of grains of GRAIN_M."""
RECORD_BYTES = 8
"""Bytes of a hit: x, y, z as 16-bit numbers, intensity, laser."""
PACKET_MAGIC = 44444
"""The number that each of the first four words of a packet in velodyne_hits.bin holds."""
PACKET_HEADER_BYTES = 24
"""Bytes of a packet before its first hit."""
BODY_T_VELODYNE_XYZRPH = (0.002, -0.004, -0.957, 0.807, 0.166, -90.703)
"""x, y, z in metres and roll, pitch, heading in degrees of the lidar in the body frame."""

SCANS = "velodyne_sync"
PACKETS = "velodyne_hits.bin"
GROUND_TRUTH = "groundtruth_{sequence}.csv"
ODOMETRY = "odometry_mu_100hz.csv"
COVARIANCE = "odometry_cov.csv"
"""Names of the files in the folder of one sequence."""
GROUND_TRUTH_PLACES = (f"{{sequence}}/{GROUND_TRUTH}", GROUND_TRUTH, f"ground_truth/{GROUND_TRUTH}")
ODOMETRY_PLACES = (f"{{sequence}}/{ODOMETRY}", f"sensor_data/{{sequence}}/{ODOMETRY}")
COVARIANCE_PLACES = (f"{{sequence}}/{COVARIANCE}", f"sensor_data/{{sequence}}/{COVARIANCE}")
"""Where the files may lie below the root of the data set, in the order of search."""
UPPER_TRIANGLE = np.triu_indices(6)
"""A row of COVARIANCE is a utime, then the upper triangle, row after row, of the covariance matrix
of x, y, z, roll, pitch, heading. These are the indices of the triangle in the matrix."""
COVARIANCE_COLUMNS = 22
"""Numbers in such a row."""
VARIANCE_COLUMNS = (1, 7, 21)
"""The columns of such a row with the variances of x, y and heading."""


def write_pose_rows(path: Path, utimes: NDArray[np.int64], rows: NDArray[np.float64]) -> None:
    """Write a file of rows (n, m) of numbers, each after its utime (n,) in µs, without a header.

    Of poses they are x, y, z in metres and roll, pitch, heading in radians, north-east-down.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        for utime, row in zip(utimes.tolist(), rows.tolist(), strict=True):
            file.write(f"{utime}, " + ", ".join(f"{value:.9g}" for value in row) + "\n")


def write_covariance_rows(
    path: Path, utimes: NDArray[np.int64], covariances: NDArray[np.float64]
) -> None:
    """Write odometry_cov.csv from `utimes` (n,) in µs and `covariances` (n, 6, 6).

    Each is the covariance of the motion since the row before.
    """
    write_pose_rows(path, utimes, covariances[:, *UPPER_TRIANGLE])


def encode(
    points_m: NDArray[np.float32], intensity: NDArray[np.uint8], laser: NDArray[np.uint8]
) -> bytes:
    """The bytes of a velodyne_sync file from z-up vehicle points (n, 3) within ±100 m.

    `intensity` and `laser` are (n,).
    """
    record = np.zeros(len(points_m), [("xyz", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])
    file_xyz_m = points_m.astype(np.float64) * (1.0, -1.0, -1.0)  # y right, z down
    record["xyz"] = np.rint((file_xyz_m - OFFSET_M) / GRAIN_M)
    record["intensity"] = intensity
    record["laser"] = laser
    return record.tobytes()


@njit(cache=True, nogil=True, error_model="numpy")
def decode(words: NDArray[np.uint16], lift_m: float = 0.0) -> NDArray[np.float64]:
    """Points (n, 3) in metres, z up and raised by `lift_m`, of the hits of a velodyne_sync file.

    `words` (4 n,) are the hits one after the other, four 16-bit words each. The compiler vectorises
    the loop, since the arrays are flat: it is 20 times as fast.
    """
    points = np.empty((words.shape[0] // 4, 3), np.float64)
    metres = points.reshape(-1)
    for i in range(words.shape[0] // 4):
        # 0.005 is GRAIN_M, −100 is OFFSET_M
        metres[3 * i] = np.int32(words[4 * i]) * 0.005 - 100.0
        # not −(… − 100), which may be −0, whose atan2 differs
        metres[3 * i + 1] = 100.0 - np.int32(words[4 * i + 1]) * 0.005
        metres[3 * i + 2] = 100.0 - np.int32(words[4 * i + 2]) * 0.005 + lift_m
    return points
