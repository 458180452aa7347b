"""The interface of all writers of logs: the truth of a drive first, then each of its scans."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pipeline.core.frames import Poses, rpy
from worlds import Floats
from worlds.driving.drive import Drive
from worlds.driving.lidar import Returns
from worlds.seeds import Generators


@dataclass
class Writer(ABC):
    """Writes one sequence into its folder, in the format of a data set."""

    folder: Path
    sequence: str
    body_T_sensor: Poses
    """(4, 4) the scanner's pose on the robot."""
    in_order: ClassVar[bool] = False
    """Whether scans must be written in order by one process. Otherwise any worker may write them,
    in any order."""

    @abstractmethod
    def write_truth(self, drive: Drive, surveyed: Drive, generators: Generators) -> None:
        """Create the folders, and write everything except the scans.

        That is the truth, which are the poses of `surveyed`; odometry of the true poses of `drive`,
        whose errors are drawn from `generators`; and the calibration.
        """

    @abstractmethod
    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write scan number `scan`, taken at `utime` in microseconds; the truth comes before."""

    def close(self) -> None:
        """Finish the log; there is nothing to do where each scan is a file of its own."""
        return


def xyzrpy(poses: Poses) -> Floats:
    """Rows (n, 6) of x, y, z in metres and roll, pitch, yaw in radians of poses (n, 4, 4)."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])
