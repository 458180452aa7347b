"""Records one sequence, one block of scans at a time."""

from dataclasses import dataclass
from datetime import date

import numpy as np

from pipeline.world.driving.day import Day, people_at
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import Lidar, Returns
from pipeline.world.seeds import scan_seed
from pipeline.world.writers.truth import TruthWriter
from pipeline.world.writers.writer import Writer

PILOT_HEIGHT_M = 1.75


@dataclass(frozen=True)
class Recording:
    """Key numbers of a recorded sequence."""

    scans: int
    points: int
    metres: float
    """Path length from the first scan to the last."""
    unseen: float
    """The share of the route outside that of the training sequence."""
    reversed: float
    """The share of the rest that is driven opposite to the training sequence."""
    unit: str = "scans"

    def __str__(self) -> str:
        driven = (
            f"{self.scans} {self.unit}, {self.points / 1e6:.1f} M points, {self.metres:.0f} m "
            "driven"
        )
        return f"{driven}; planned {self.unseen:.0%} unseen, {self.reversed:.0%} reversed"


@dataclass(frozen=True)
class Recorder:
    """Everything that a worker needs to record any block of scans of a sequence.

    It can be sent to other processes.
    """

    seed: int
    when: date
    day: Day
    drive: Drive
    keep_off_m: float
    lidar: Lidar
    truth: TruthWriter | None
    logs: Writer | None = None
    """None: the scans are returned, and one process writes them."""

    def block(self, start: int, stop: int) -> tuple[int, list[tuple[int, int, Returns]]]:
        """Record the scans from `start` up to, but not including, `stop`.

        Returns the number of their points, and the number, utime and returns of the scans that one
        process must write, in order.
        """
        points = 0
        unwritten = []
        for scan in range(start, stop):
            utime = int(self.drive.scan_utimes[scan])
            returns = self._scan(scan)
            points += len(returns.points_m)
            if self.truth:
                self.truth.write_scan(utime, returns)
            if self.logs:
                self.logs.write_scan(scan, utime, returns)
            else:
                unwritten.append((scan, utime, returns))
        return points, unwritten

    def _scan(self, scan: int) -> Returns:
        world_T_body = self.drive.world_T_body[self.drive.scan_rows[scan]]
        movers = self.day.movers(self.drive.time_s(scan), world_T_body[:2, 3], self.keep_off_m)
        if self.drive.pilot_m is not None:
            pilot = people_at(
                self.drive.pilot_m[scan][None], np.array([PILOT_HEIGHT_M]), self.day.ground
            )
            movers = np.concatenate([movers, pilot])
        poses = world_T_body[None]
        if self.lidar.turn_s:
            fired_us = np.rint(1e6 * self.lidar.fired_s).astype(np.int64)
            poses = self.drive.at(self.drive.scan_utimes[scan] + fired_us)
        return self.lidar.scan(self.day.scene, movers, poses, scan_seed(self.seed, self.when, scan))
