"""Writes a simulated drive as a ROS bag (METHODS 7.4).

The bag holds clouds in the lidar's frame, the true poses, wheel odometry with its covariance, and
the lidar's pose on the robot.
"""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses
from pipeline.formats.bag import BagWriter
from worlds.driving.drive import Drive
from worlds.driving.lidar import Returns
from worlds.driving.odometry import wheel_covariances, wheel_odometry
from worlds.seeds import Generators, Stream
from worlds.writers.writer import Writer

# topics
CLOUDS = "/points"
GROUND_TRUTH = "/ground_truth"
ODOMETRY = "/odom"
# frames
WORLD = "map"
ODOM = "odom"
BODY = "base_link"
LIDAR = "velodyne"


class _StampedPoses(NamedTuple):
    """The true pose and the odometry at one stamp."""

    utime: int
    world_T_body: Poses
    odom_T_body: Poses
    covariance: NDArray[np.float64]
    """(6, 6) gathered by odometry up to this stamp."""


class BagWriterInOrder(Writer):
    """Writes one sequence, with its messages in the order of their stamps.

    The file is `bag.bag` of ROS 1, or the folder `bag` of ROS 2.
    """

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
        self._waiting_poses: list[_StampedPoses] = []  # the next one last

    def write_ground_truth(self, drive: Drive, reference: Drive, generators: Generators) -> None:
        """Write the lidar's pose on the robot, and keep all other poses until their stamps are due.

        `write_scan` writes them when it reaches their stamps.
        """
        self._bag.static_transform(int(drive.utimes[0]) * 1000, BODY, LIDAR, self.body_T_sensor)
        odom_T_body = wheel_odometry(generators(Stream.ODOMETRY), drive.world_T_body)
        covariance = np.cumsum(wheel_covariances(drive.world_T_body), axis=0)
        columns = (drive.utimes.tolist(), reference.world_T_body, odom_T_body, covariance)
        rows = [_StampedPoses(*row) for row in zip(*columns, strict=True)]
        self._waiting_poses = rows[::-1]

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

    def _write_poses(self, until_utime: int | None) -> None:
        """Write the waiting poses up to a stamp in microseconds, or all of them."""
        while self._waiting_poses and (
            until_utime is None or self._waiting_poses[-1].utime <= until_utime
        ):
            poses = self._waiting_poses.pop()
            stamp_ns = poses.utime * 1000
            self._bag.odometry(stamp_ns, WORLD, BODY, poses.world_T_body, GROUND_TRUTH)
            self._bag.odometry(stamp_ns, ODOM, BODY, poses.odom_T_body, ODOMETRY, poses.covariance)
