"""Records one sequence: takes its scans along the drive, one block of scans at a time.

A `Recorder` holds all that a worker process needs for any block, so that blocks run in parallel.
"""

from dataclasses import dataclass
from datetime import date

import numpy as np

from worlds.driving.day import Day, people_at
from worlds.driving.drive import Drive
from worlds.driving.lidar import Lidar, Returns
from worlds.seeds import scan_seed
from worlds.writers.writer import GroundTruthWriter, Writer

PILOT_HEIGHT_M = 1.75
"""Height of the person who walks behind the robot."""


@dataclass(frozen=True)
class Recording:
    """Key numbers of a recorded sequence; as a text they are one line."""

    scans: int
    """Number of scans."""
    points: int
    """Number of points."""
    metres: float
    """Path length from the first scan to the last."""
    unseen: float
    """Planned share of the route outside that of the training sequence."""
    reversed: float
    """Planned share of the rest that is driven opposite to the training sequence."""
    unit: str = "scans"
    """What was recorded: scans or sweeps."""

    def __str__(self) -> str:
        driven = (
            f"{self.scans} {self.unit}, {self.points / 1e6:.1f} M points, {self.metres:.0f} m "
            "driven"
        )
        return f"{driven}; planned {self.unseen:.0%} unseen, {self.reversed:.0%} reversed"


@dataclass(frozen=True)
class Recorder:
    """Everything that a worker process needs to record any block of scans of a sequence."""

    seed: int
    """The seed of the world."""
    when: date
    day: Day
    drive: Drive
    keep_off_m: float
    """Distance from the robot within which nobody walks or drives, except the pilot."""
    lidar: Lidar
    ground_truth: GroundTruthWriter | None
    """Writes the kinds of points, if wanted."""
    logs: Writer | None = None
    """Writes the scans; None if they are returned for one process to write them in order."""

    def block(self, start: int, stop: int) -> tuple[int, list[tuple[int, int, Returns]]]:
        """Record the scans from `start` to before `stop`.

        Returns the number of their points, and the scans that are not written yet, in order: each
        with its number, its stamp in microseconds, and its returns.
        """
        points = 0
        unwritten = []
        for scan in range(start, stop):
            utime = int(self.drive.scan_utimes[scan])
            returns = self._scan(scan)
            points += len(returns.points_m)
            if self.ground_truth:
                self.ground_truth.write_scan(utime, returns)
            if self.logs:
                self.logs.write_scan(scan, utime, returns)
            else:
                unwritten.append((scan, utime, returns))
        return points, unwritten

    def _scan(self, scan: int) -> Returns:
        """Take one scan."""
        world_T_body = self.drive.world_T_body[self.drive.scan_rows[scan]]
        movers = self.day.movers(self.drive.time_s(scan), world_T_body[:2, 3], self.keep_off_m)
        if self.drive.pilot_m is not None:
            pilot_m = self.drive.pilot_m[scan][None]
            pilot = people_at(pilot_m, np.array([PILOT_HEIGHT_M]), self.day.ground)
            movers = np.concatenate([movers, pilot])
        poses = world_T_body[None]
        if self.lidar.turn_s:
            # The robot moves on while the scanner turns.
            fired_us = np.rint(1e6 * self.lidar.fired_s).astype(np.int64)
            poses = self.drive.at(self.drive.scan_utimes[scan] + fired_us)
        return self.lidar.scan(self.day.scene, movers, poses, scan_seed(self.seed, self.when, scan))
