"""Reads the key frames of a SLAM run, as published of NCLT's 2013-01-10 (METHODS 7.6).

ROOT/SEQUENCE/0.pcd …          the clouds
ROOT/SEQUENCE/keyframes.txt    id, stamp in s, three flags, then x y z qx qy qz qw by odometry, RTK,
                               and two optimisations
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pipeline.core import settings
from pipeline.core.errors import LogError
from pipeline.core.frames import Trajectory
from pipeline.readers import log, vehicle
from pipeline.readers.folder import from_quaternions, read_scan
from pipeline.readers.log import Log

FILE = "keyframes.txt"
COLUMNS = 33
"""Numbers of a row."""
MOST = 10**9
"""Clouds have smaller numbers than this."""
POSES = {"odometry": 5, "rtk": 12, "optimised_1": 19, "optimised_2": 26}
"""First column of each pose."""


@dataclass(frozen=True)
class KeyFrames:
    """A folder of SLAM runs, each a sequence."""

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
        misnumbered = np.flatnonzero(
            ~((rows[:, 0] >= 0) & (rows[:, 0] < MOST)) | (rows[:, 0] != np.floor(rows[:, 0]))
        )
        if len(misnumbered):
            raise LogError(
                f"{folder / FILE}: row {misnumbered[0] + 1} names cloud "
                f"{rows[misnumbered[0], 0]:g}; expected a whole number"
            )
        paths = [folder / f"{number:.0f}.pcd" for number in rows[:, 0]]
        on_disk = np.array([path.is_file() for path in paths])
        skipped["no such file"] += int((~on_disk).sum())
        if not on_disk.any():
            raise LogError(f"{folder}: none of the {len(rows)} clouds that {FILE} names")
        rows = rows[on_disk]
        cloud_paths = [path for path, is_on_disk in zip(paths, on_disk, strict=True) if is_on_disk]
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
            lambda row: read_scan(cloud_paths[row], vehicle_T_lidar),
            +skipped,
            notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        return {path.parent.name: [] for path in sorted(root.glob(f"*/{FILE}"))}
