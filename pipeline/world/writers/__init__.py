"""Writers of a drive as raw logs in the formats of the data sets, one module per format."""

from pathlib import Path
from typing import Literal

from pipeline.world.driving.lidar import Lidar
from pipeline.world.writers.kitti import KittiWriter
from pipeline.world.writers.nclt import NcltWriter
from pipeline.world.writers.robotcar import ORIGIN_M, RobotCarWriter
from pipeline.world.writers.writer import Writer

FILES: dict[str, type[Writer]] = {
    "nclt": NcltWriter,
    "robotcar": RobotCarWriter,
    "kitti": KittiWriter,
}
BAGS = ("ros1", "sqlite3", "mcap")
Format = Literal["nclt", "robotcar", "kitti", "ros1", "sqlite3", "mcap"]


def origin_m(logs: Format) -> tuple[float, float, float]:
    """The origin of the simulated world, in metres in the world frame that the reader of the format
    returns."""
    return ORIGIN_M if logs == "robotcar" else (0.0, 0.0, 0.0)


def writer(logs: Format, folder: Path, sequence: str, lidar: Lidar) -> Writer:
    """The writer of the format `logs`."""
    if logs == "ros1" or logs == "sqlite3" or logs == "mcap":
        from pipeline.world.writers.bag import (
            BagWriterInOrder,
        )  # it imports rosbags, which no other format needs

        return BagWriterInOrder(folder, sequence, lidar.body_T_sensor, logs)
    return FILES[logs](folder, sequence, lidar.body_T_sensor)
