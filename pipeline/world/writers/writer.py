"""What all writers of logs do, and what those share that write one file per scan."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pipeline.core.frames import Poses, rpy
from pipeline.world import Floats
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Returns
from pipeline.world.seeds import Generators


@dataclass
class Writer(ABC):
    """Writes one sequence into its folder."""

    folder: Path
    sequence: str
    body_T_sensor: Poses
    in_order: ClassVar[bool] = False
    """Whether the scans must be written in order by one process; otherwise any worker may write
    them in any order."""

    @abstractmethod
    def write_truth(self, drive: Drive, surveyed: Drive, generators: Generators) -> None:
        """Create the folders, and write everything but the scans: the poses as `surveyed`, the
        odometry and the calibration."""

    @abstractmethod
    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write one scan, after the truth."""

    def close(self) -> None:
        """Finish the log; nothing is open where each scan is a file."""
        return


def xyzrpy(poses: Poses) -> Floats:
    """Rows (n, 6) of x, y, z in metres and roll, pitch, yaw in radians of poses (n, 4, 4)."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])
