"""Key frames of a SLAM run: clouds N.pcd and keyframes.txt with four poses each, as published of
NCLT's 2013-01-10 (METHODS 7.6).

ROOT/SEQUENCE/keyframes.txt    id, stamp in s, three flags, then x y z qx qy qz qw by odometry, RTK,
and two optimisations ROOT/SEQUENCE/0.pcd …
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.errors import LogError
from pipeline.frames import Trajectory
from pipeline.readers import log, vehicle
from pipeline.readers.folder import from_quaternions, read_scan
from pipeline.readers.log import Log
from pipeline.running import settings

FILE = "keyframes.txt"
COLUMNS = 33
"""Numbers of a row."""
MOST = 10**9
"""Clouds are numbered below it."""
POSES = {"odometry": 5, "rtk": 12, "optimised_1": 19, "optimised_2": 26}
"""First column of each pose."""


@dataclass(frozen=True)
class KeyFrames:
    """A folder of such runs."""

    truth: Literal["rtk", "optimised_1", "optimised_2"] = "optimised_2"
    """Which poses are the truth; the odometry is the run's own."""
    body_T_lidar: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """x, y, z in metres and roll, pitch, yaw in degrees of the stored frame in the body's: x
    forward, y left, z up."""
    lift_m: float = 0.0
    """Height of the body's origin above the ground, added to z."""

    def __post_init__(self) -> None:
        settings.check(self, "reader")
        log.extrinsic("reader.body_T_lidar", self.body_T_lidar)

    def open(self, root: Path, sequence: str) -> Log:
        folder = root / sequence
        skipped = Counter[str]()
        rows = log.table(folder / FILE, COLUMNS)
        odd = np.flatnonzero(
            ~((rows[:, 0] >= 0) & (rows[:, 0] < MOST)) | (rows[:, 0] != np.floor(rows[:, 0]))
        )
        if len(odd):
            raise LogError(
                f"{folder / FILE}: row {odd[0] + 1} names cloud {rows[odd[0], 0]:g}; expected a "
                "whole number"
            )
        paths = [folder / f"{number:.0f}.pcd" for number in rows[:, 0]]
        there = np.array([path.is_file() for path in paths])
        skipped["no such file"] += int((~there).sum())
        if not there.any():
            raise LogError(f"{folder}: none of the {len(rows)} clouds that {FILE} names")
        rows = rows[there]
        kept = [path for path, found in zip(paths, there, strict=True) if found]
        stamps_ns = log.nanoseconds(folder / FILE, rows[:, 1], "s", 10**9)
        body_T_lidar = log.extrinsic("reader.body_T_lidar", self.body_T_lidar)
        world_T_lidar = (
            from_quaternions(folder / FILE, rows[:, POSES[name] :][:, :7])
            for name in (self.truth, "odometry")
        )
        truth, odometry = (
            log.lifted(poses @ np.linalg.inv(body_T_lidar), self.lift_m) for poses in world_T_lidar
        )
        vehicle_T_lidar = log.raised(self.lift_m) @ body_T_lidar
        notes = vehicle.doubts("the true poses", Trajectory(stamps_ns, truth, np.inf))
        return Log(
            stamps_ns,
            truth,
            odometry,
            lambda row: read_scan(kept[row], vehicle_T_lidar),
            +skipped,
            notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        return {path.parent.name: [] for path in sorted(root.glob(f"*/{FILE}"))}
