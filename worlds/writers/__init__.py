"""Writers of simulated drives as raw logs in the formats of real data sets, one module per format.

`writer` makes the writer of a format.
"""

from pathlib import Path
from typing import Literal

from worlds.driving.lidar import Lidar
from worlds.writers.kitti import KittiWriter
from worlds.writers.nclt import NcltWriter
from worlds.writers.robotcar import ORIGIN_M, RobotCarWriter
from worlds.writers.writer import Writer

FILE_WRITERS: dict[str, type[Writer]] = {
    "nclt": NcltWriter,
    "robotcar": RobotCarWriter,
    "kitti": KittiWriter,
}
"""The writers that write one file per scan."""
BAGS = ("ros1", "sqlite3", "mcap")
"""The kinds of ROS bags: of ROS 1, and of ROS 2 with two kinds of storage."""
Format = Literal["nclt", "robotcar", "kitti", "ros1", "sqlite3", "mcap"]
"""All names above; spelled out, since a type checker cannot read them from there."""


def origin_m(log_format: Format) -> tuple[float, float, float]:
    """x, y and z of the simulated world's origin, in metres in the world frame that the format's
    reader returns."""
    return ORIGIN_M if log_format == "robotcar" else (0.0, 0.0, 0.0)


def writer(log_format: Format, folder: Path, sequence: str, lidar: Lidar) -> Writer:
    """Make the writer of a format for one sequence, which writes into `folder`.

    A bag is one file for all scans, so its writer must get them in the order of their stamps.
    """
    # Not `log_format in BAGS`: from these comparisons the type checker knows what is left.
    if log_format == "ros1" or log_format == "sqlite3" or log_format == "mcap":
        # Imported only here, since it imports rosbags, which no other format needs.
        from worlds.writers.bag import BagWriterInOrder

        return BagWriterInOrder(folder, sequence, lidar.body_T_sensor, log_format)
    return FILE_WRITERS[log_format](folder, sequence, lidar.body_T_sensor)
