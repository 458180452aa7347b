"""The robots: how each moves, what it carries, and whose logs it writes."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date

from pipeline.world.driving.lidar import Lidar, hdl32, hdl64, lms151
from pipeline.world.driving.motion import CAR, SEGWAY, Motion
from pipeline.world.names import kitti_date, nclt_date, robotcar_time
from pipeline.world.writers import BAGS


@dataclass(frozen=True)
class Robot:
    """One of the data sets' robots."""

    motion: Motion
    lidar: Callable[[int], Lidar]
    """The scanner, given its rays per turn of a beam, or per sweep."""
    departs: Callable[[str], date]
    """When a sequence of that name was driven; raises ConfigError for no such name."""
    logs: tuple[str, ...]
    """The formats that hold what it records."""
    sees: str = "scans"
    streets_only: bool = False
    """Whether all ways of its world are roads."""
    loops: bool = False
    """Whether each log is a place of its own, whose second half drives the first half's streets again."""


ROBOTS = {
    "segway": Robot(SEGWAY, hdl32, nclt_date, ("nclt", *BAGS)),
    "push_broom_car": Robot(CAR, lms151, robotcar_time, ("robotcar",), sees="sweeps", streets_only=True),
    "scanner_car": Robot(CAR, hdl64, kitti_date, ("kitti", *BAGS), streets_only=True, loops=True),
}
