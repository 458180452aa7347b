"""NCLT's layout and frames: velodyne_sync scans in the body's frame, ground truth and wheel odometry (METHODS 7.1)."""

from pathlib import Path

import numpy as np

from pipeline.formats.nclt import ODOMETRY, SCANS, TRUTH, encode, write_pose_rows
from pipeline.frames import flip_ned
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Returns
from pipeline.world.driving.odometry import integrate
from pipeline.world.seeds import Noise, Stream
from pipeline.world.writers.files import FilesWriter
from pipeline.world.writers.rows import xyzrpy

LEADING_GAPS = 5
"""Rows of NaN that open the truth, as in the real files, before the SLAM solution sets in."""


class NcltWriter(FilesWriter):
    """Writes one sequence into its folder."""

    def open(self) -> None:
        self._scans().mkdir(parents=True, exist_ok=True)

    def write_truth(self, drive: Drive, noise: Noise) -> None:
        """The ground truth, whose first LEADING_GAPS rows are NaN, and the integrated odometry."""
        rows = xyzrpy(flip_ned(drive.world_T_body))
        rows[:LEADING_GAPS] = np.nan
        write_pose_rows(self.folder / TRUTH.format(sequence=self.sequence), drive.utimes, rows)
        drifted = integrate(noise(Stream.ODOMETRY), drive.world_T_body)
        write_pose_rows(self.folder / ODOMETRY, drive.utimes, xyzrpy(flip_ned(drifted)))

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """velodyne_sync/<utime>.bin."""
        points_m = returns.points_m @ self.body_T_sensor[:3, :3].T + self.body_T_sensor[:3, 3]
        (self._scans() / f"{utime}.bin").write_bytes(encode(points_m.astype(np.float32), returns.intensity, returns.laser))

    def _scans(self) -> Path:
        return self.folder / SCANS
