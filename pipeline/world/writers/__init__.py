"""Writers of a drive as raw logs in the formats of the data sets, one module per format."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Lidar, Returns
from pipeline.world.seeds import Noise
from pipeline.world.writers.kitti import KittiWriter
from pipeline.world.writers.nclt import NcltWriter
from pipeline.world.writers.robotcar import ORIGIN_M, RobotCarWriter


class Writer(Protocol):
    """Writes one sequence into its folder."""

    @property
    def in_order(self) -> bool:
        """Whether the scans must be written in order by one process; otherwise any worker may write them in any order."""

    def open(self) -> None:
        """Create the folders."""

    def write_truth(self, drive: Drive, noise: Noise) -> None:
        """Write everything but the scans: the true poses, the odometry and the calibration."""

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write one scan."""

    def close(self) -> None:
        """Finish the log."""


Files = Callable[[Path, str, Poses], Writer]
FILES: dict[str, Files] = {"nclt": NcltWriter, "robotcar": RobotCarWriter, "kitti": KittiWriter}
BAGS = ("ros1", "sqlite3", "mcap")
Format = Literal["nclt", "robotcar", "kitti", "ros1", "sqlite3", "mcap"]


def origin_m(logs: Format) -> NDArray[np.float64]:
    """The origin (3,) of the simulated world, in metres in the world frame that the reader of the format returns."""
    return np.array(ORIGIN_M if logs == "robotcar" else (0.0, 0.0, 0.0))


def writer(logs: Format, folder: Path, sequence: str, lidar: Lidar) -> Writer:
    """The writer of the format `logs`."""
    if logs == "ros1" or logs == "sqlite3" or logs == "mcap":
        from pipeline.world.writers.bag import BagWriterInOrder  # it imports rosbags, which no other format needs

        return BagWriterInOrder(folder, lidar.body_T_sensor, logs)
    return FILES[logs](folder, sequence, lidar.body_T_sensor)
