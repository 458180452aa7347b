"""Writes a ROS bag (METHODS 7.4).

It holds clouds in the lidar's frame, the truth, the wheel odometry and the extrinsics.
"""

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses
from pipeline.formats.bag import BagWriter
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Returns
from pipeline.world.driving.odometry import wheel_covariances, wheel_odometry
from pipeline.world.seeds import Generators, Stream
from pipeline.world.writers.writer import Writer

CLOUDS = "/points"
TRUTH = "/ground_truth"
ODOMETRY = "/odom"
WORLD = "map"
START = "odom"
BODY = "base_link"
LIDAR = "velodyne"


class BagWriterInOrder(Writer):
    """Writes one sequence as `bag.bag`, or as the folder `bag` of ROS 2, in its folder, with
    messages in order of time."""

    in_order = True

    def __init__(
        self,
        folder: Path,
        sequence: str,
        body_T_sensor: Poses,
        kind: Literal["ros1", "sqlite3", "mcap"],
    ) -> None:
        super().__init__(folder, sequence, body_T_sensor)
        self._bag = BagWriter(folder / ("bag.bag" if kind == "ros1" else "bag"), kind).__enter__()
        self._waiting: list[tuple[int, Poses, Poses, NDArray[np.float64]]] = []

    def write_truth(self, drive: Drive, surveyed: Drive, generators: Generators) -> None:
        """Write the extrinsics, and keep the true poses and the odometry until `write_scan` reaches
        their stamps."""
        self._bag.static_transform(int(drive.utimes[0]) * 1000, BODY, LIDAR, self.body_T_sensor)
        drifted = wheel_odometry(generators(Stream.ODOMETRY), drive.world_T_body)
        self._waiting = list(
            zip(
                drive.utimes.tolist(),
                surveyed.world_T_body,
                drifted,
                np.cumsum(wheel_covariances(drive.world_T_body), axis=0),
                strict=True,
            )
        )[::-1]

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write the poses up to the stamp of the scan, and its cloud."""
        self._write_poses(utime)
        points_m = returns.points_m.astype(np.float32)
        intensity = returns.intensity.astype(np.float32)
        self._bag.points(
            utime * 1000, LIDAR, points_m, intensity, returns.laser, CLOUDS, returns.times_s
        )

    def close(self) -> None:
        """Write the poses after the last scan, and the index of the bag."""
        self._write_poses(None)
        self._bag.__exit__(None, None, None)

    def _write_poses(self, until: int | None) -> None:
        while self._waiting and (until is None or self._waiting[-1][0] <= until):
            utime, world_T_body, start_T_body, covariance = self._waiting.pop()
            self._bag.odometry(utime * 1000, WORLD, BODY, world_T_body, TRUTH)
            self._bag.odometry(utime * 1000, START, BODY, start_T_body, ODOMETRY, covariance)
