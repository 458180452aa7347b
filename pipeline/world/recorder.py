"""One sequence being recorded, a block of scans at a time."""

from dataclasses import dataclass
from datetime import date

import numpy as np

from pipeline.world.day import Day, people_at
from pipeline.world.drive import Drive
from pipeline.world.lidar import Lidar
from pipeline.world.seeds import scan_seed
from pipeline.world.writers import NcltWriter, TruthWriter

PILOT_HEIGHT_M = 1.75


@dataclass(frozen=True)
class Recorder:
    """Everything that a worker needs to write any block of a sequence's scans; it can be pickled."""

    seed: int
    date: date
    day: Day
    drive: Drive
    lidar: Lidar
    logs: NcltWriter
    truth: TruthWriter | None

    def block(self, start: int, stop: int) -> tuple[int, int]:
        """Write scans `start` to `stop`; returns how many scans and points that were."""
        return stop - start, sum(self._scan(scan) for scan in range(start, stop))

    def _scan(self, scan: int) -> int:
        row = self.drive.scan_rows[scan]
        world_T_body, utime = self.drive.world_T_body[row], int(self.drive.utimes[row])
        pilot = people_at(self.drive.pilot_m[scan][None], np.array([PILOT_HEIGHT_M]), self.day.ground)
        movers = np.concatenate([self.day.movers(self.drive.time_s(scan), world_T_body[:2, 3]), pilot])
        returns = self.lidar.scan(self.day.scene, movers, world_T_body, scan_seed(self.seed, self.date, scan))
        self.logs.write_scan(utime, returns)
        if self.truth:
            self.truth.write_scan(utime, returns)
        return len(returns.points_m)
