"""The logs of a drive in NCLT's own layout and frames, and the truth that a real robot would not know, beside them."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pipeline.formats.nclt import ODOMETRY, SCANS, TRUTH, encode, write_pose_rows
from pipeline.frames import Poses, Stamps, flip_ned, rpy
from pipeline.world.events import Event
from pipeline.world.lidar import Returns

LEADING_GAPS = 5
"""Rows of NaN that open the truth, as in the real files, before the SLAM solution sets in."""


@dataclass(frozen=True)
class NcltWriter:
    """Writes one sequence into its folder."""

    folder: Path
    sequence: str

    def open(self) -> None:
        """Make the scans' folder."""
        self._scans().mkdir(parents=True, exist_ok=True)

    def write_scan(self, utime: int, returns: Returns) -> None:
        """Write velodyne_sync/<utime>.bin."""
        (self._scans() / f"{utime}.bin").write_bytes(encode(returns.points_m, returns.intensity, returns.laser))

    def write_truth(self, utimes: Stamps, world_T_body: Poses) -> None:
        """Write the ground truth: LEADING_GAPS rows of NaN, then the poses (n, 4, 4), given z up, as north-east-down."""
        rows = _ned_rows(world_T_body)
        rows[:LEADING_GAPS] = np.nan
        write_pose_rows(self.folder / TRUTH.format(sequence=self.sequence), utimes, rows)

    def write_odometry(self, utimes: Stamps, start_T_body: Poses) -> None:
        """Write the integrated odometry, poses (n, 4, 4) given z up, as north-east-down."""
        write_pose_rows(self.folder / ODOMETRY, utimes, _ned_rows(start_T_body))

    def _scans(self) -> Path:
        return self.folder / SCANS


@dataclass(frozen=True)
class TruthWriter:
    """Writes what each point is and what changed: truth/SEQ/kinds/<utime>.npy, uint8 in the scan's own order, and year.json."""

    root: Path
    sequence: str

    def open(self) -> None:
        """Make the folder."""
        self._kinds().mkdir(parents=True, exist_ok=True)

    def write_scan(self, utime: int, returns: Returns) -> None:
        """Write what each point of a scan lies on."""
        np.save(self._kinds() / f"{utime}.npy", returns.kind)

    def write_year(self, day: int, events: Sequence[Event], plan: dict[str, float]) -> None:
        """Write the events of the whole year, the sequence's own day in it, and how its route relates to the training one."""
        year = {"day": day, "events": [asdict(event) for event in events], "plan": plan}
        (self.root / self.sequence / "year.json").write_text(json.dumps(year, indent=1) + "\n")

    def _kinds(self) -> Path:
        return self.root / self.sequence / "kinds"


def _ned_rows(poses: Poses) -> np.ndarray:
    """Rows (n, 6) of x, y, z, roll, pitch, heading of z-up poses, in north-east-down."""
    ned = flip_ned(poses)
    return np.column_stack([ned[:, :3, 3], rpy(ned)])
