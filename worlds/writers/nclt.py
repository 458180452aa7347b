"""Writes a simulated drive in the files and frames of NCLT (METHODS 7.1): velodyne_sync scans,
ground truth, and wheel odometry with its covariance.
"""

import numpy as np

from pipeline.core.frames import flip_ned, transformed
from pipeline.formats.nclt import (
    COVARIANCE,
    GROUND_TRUTH,
    ODOMETRY,
    SCANS,
    encode,
    write_covariance_rows,
    write_pose_rows,
)
from worlds.driving.drive import Drive
from worlds.driving.lidar import Returns
from worlds.driving.odometry import wheel_covariances, wheel_odometry
from worlds.seeds import Generators, Stream
from worlds.writers.writer import Writer, xyzrpy

LEADING_GAPS = 5
"""Number of NaN rows at the start of the ground truth. In the real files the SLAM solution begins
later than the odometry."""


class NcltWriter(Writer):
    """Writes one sequence into its folder."""

    def write_ground_truth(self, drive: Drive, reference: Drive, generators: Generators) -> None:
        """Write the ground truth, whose first LEADING_GAPS rows are NaN, and the wheel odometry."""
        (self.folder / SCANS).mkdir(parents=True, exist_ok=True)
        rows = xyzrpy(flip_ned(reference.world_T_body))
        rows[:LEADING_GAPS] = np.nan
        write_pose_rows(
            self.folder / GROUND_TRUTH.format(sequence=self.sequence), drive.utimes, rows
        )
        odom_T_body = wheel_odometry(generators(Stream.ODOMETRY), drive.world_T_body)
        write_pose_rows(self.folder / ODOMETRY, drive.utimes, xyzrpy(flip_ned(odom_T_body)))
        covariances = wheel_covariances(drive.world_T_body)
        write_covariance_rows(self.folder / COVARIANCE, drive.utimes, covariances)

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write velodyne_sync/<utime>.bin, with points in the body's frame."""
        points_m = transformed(self.body_T_sensor, returns.points_m)
        data = encode(points_m.astype(np.float32), returns.intensity, returns.laser)
        (self.folder / SCANS / f"{utime}.bin").write_bytes(data)
