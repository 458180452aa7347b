"""Writers of simulated drives as raw logs in the formats of real data sets, one module per format.

`writer` makes the one of a format.
"""

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
"""The writers that write one file per scan."""
BAGS = ("ros1", "sqlite3", "mcap")
"""The kinds of ROS bags: of ROS 1, and of ROS 2 with two kinds of storage."""
Format = Literal["nclt", "robotcar", "kitti", "ros1", "sqlite3", "mcap"]


def origin_m(logs: Format) -> tuple[float, float, float]:
    """x, y and z of the simulated world's origin, in metres in the world frame that the format's
    reader returns."""
    return ORIGIN_M if logs == "robotcar" else (0.0, 0.0, 0.0)


def writer(logs: Format, folder: Path, sequence: str, lidar: Lidar) -> Writer:
    """Make the writer of the format `logs` for one sequence, which writes into `folder`."""
    if logs == "ros1" or logs == "sqlite3" or logs == "mcap":
        # Imported only here, since it imports rosbags, which no other format needs.
        from pipeline.world.writers.bag import BagWriterInOrder

        return BagWriterInOrder(folder, sequence, lidar.body_T_sensor, logs)
    return FILES[logs](folder, sequence, lidar.body_T_sensor)
