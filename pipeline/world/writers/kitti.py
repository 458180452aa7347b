"""Writes the layout and frames of KITTI odometry, with a root of its own for each log (METHODS
7.3)."""

from pathlib import Path

import numpy as np

from pipeline.formats import kitti
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Returns
from pipeline.world.names import kitti_log
from pipeline.world.seeds import Generators
from pipeline.world.writers.writer import Writer


class KittiWriter(Writer):
    """Writes one log into its folder.

    `00-a` and `00-b` are both the whole log 00, and the reader splits it.
    """

    def write_truth(self, drive: Drive, surveyed: Drive, generators: Generators) -> None:
        """Write the calibration, the times since the first scan, and the poses of cam0 in its first
        frame; no odometry."""
        log = kitti_log(self.sequence)
        self._scans().mkdir(parents=True, exist_ok=True)
        kitti.write_calib(self.folder / kitti.CALIB.format(log=log))
        kitti.write_times(
            self.folder / kitti.TIMES.format(log=log),
            (drive.scan_utimes - drive.scan_utimes[0]) / 1e6,
        )
        world_T_cam = (
            surveyed.world_T_body[drive.scan_rows]
            @ self.body_T_sensor
            @ np.linalg.inv(kitti.CAM_T_VELO)
        )
        kitti.write_poses(
            self.folder / kitti.POSES.format(log=log), np.linalg.inv(world_T_cam[0]) @ world_T_cam
        )

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """velodyne/<scan>.bin."""
        data = kitti.encode(returns.points_m, returns.intensity / 255)
        (self._scans() / f"{scan:06d}.bin").write_bytes(data)

    def _scans(self) -> Path:
        return self.folder / kitti.SCANS.format(log=kitti_log(self.sequence))
