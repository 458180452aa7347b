"""Writes a simulated drive in the files and frames of KITTI odometry (METHODS 7.3).

Each log gets a root folder of its own.
"""

from pathlib import Path

import numpy as np

from pipeline.formats import kitti
from worlds.driving.drive import Drive
from worlds.driving.lidar import Returns
from worlds.names import kitti_log
from worlds.seeds import Generators
from worlds.writers.writer import Writer


class KittiWriter(Writer):
    """Writes one log into its folder.

    `00-a` and `00-b` are both the whole log 00, and the reader splits it.
    """

    def write_ground_truth(self, drive: Drive, reference: Drive, generators: Generators) -> None:
        """Write the calibration, the times since the first scan, and the poses of camera 0.

        Poses are relative to the first one. KITTI has no odometry.
        """
        log = kitti_log(self.sequence)
        self._scans().mkdir(parents=True, exist_ok=True)
        kitti.write_calib(self.folder / kitti.CALIB.format(log=log))
        times_s = (drive.scan_utimes - drive.scan_utimes[0]) / 1e6
        kitti.write_times(self.folder / kitti.TIMES.format(log=log), times_s)
        world_T_velo = reference.world_T_body[drive.scan_rows] @ self.body_T_sensor
        world_T_cam = world_T_velo @ np.linalg.inv(kitti.CAM_T_VELO)
        first_T_cam = np.linalg.inv(world_T_cam[0]) @ world_T_cam
        kitti.write_poses(self.folder / kitti.POSES.format(log=log), first_T_cam)

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write velodyne/<scan>.bin."""
        data = kitti.encode(returns.points_m, returns.intensity / 255)
        (self._scans() / f"{scan:06d}.bin").write_bytes(data)

    def _scans(self) -> Path:
        """The folder of the scans."""
        return self.folder / kitti.SCANS.format(log=kitti_log(self.sequence))
