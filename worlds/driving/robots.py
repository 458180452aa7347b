"""The robots of the simulated worlds: how each moves, scans, and writes its logs."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date

from worlds.driving.drive import CAR, SEGWAY, Motion
from worlds.driving.lidar import Lidar, hdl32, hdl32_inverted, hdl64, lms151
from worlds.names import kitti_date, nclt_date, robotcar_time
from worlds.writers import BAGS


@dataclass(frozen=True)
class Robot:
    """A robot like that of one of the real data sets."""

    motion: Motion
    lidar: Callable[[int], Lidar]
    """Makes its scanner, given the number of rays per turn of each beam, or per sweep."""
    departs: Callable[[str], date]
    """Reads the date or time of a sequence from its name; raises ConfigError for a wrong name."""
    logs: tuple[str, ...]
    """The formats of logs that it can write."""
    unit: str = "scans"
    """What it records: scans or sweeps."""
    streets_only: bool = False
    """Whether its world has roads but no footpaths."""
    loops: bool = False
    """Whether each log has a world of its own, and its second half meets the first again."""


ROBOTS = {
    "segway": Robot(SEGWAY, hdl32, nclt_date, ("nclt", *BAGS)),
    "segway_inverted": Robot(SEGWAY, hdl32_inverted, nclt_date, ("nclt", *BAGS)),
    "push_broom_car": Robot(
        CAR, lms151, robotcar_time, ("robotcar",), unit="sweeps", streets_only=True
    ),
    "scanner_car": Robot(CAR, hdl64, kitti_date, ("kitti", *BAGS), streets_only=True, loops=True),
}
