"""Reads the key frames of a SLAM run as a Log (METHODS 7.6).

A key frame is a scan that the SLAM program kept. Those of NCLT's drive of 2013-01-10 are published:

ROOT/SEQUENCE/0.pcd …          the clouds
ROOT/SEQUENCE/keyframes.txt    a row per cloud: its number, stamp in s, three flags, then four poses
                               x y z qx qy qz qw: by odometry, by RTK, and by two optimisations
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core import settings
from pipeline.core.errors import LogError
from pipeline.core.frames import Trajectory
from pipeline.readers import log, vehicle
from pipeline.readers.folder import from_quaternions, read_scan
from pipeline.readers.log import Log

FILE = "keyframes.txt"
COLUMNS = 33
"""Numbers in a row of keyframes.txt."""
NUMBER_COLUMN = 0
STAMP_COLUMN = 1
POSE_COLUMNS = {
    "odometry": slice(5, 12),
    "rtk": slice(12, 19),
    "optimised_1": slice(19, 26),
    "optimised_2": slice(26, 33),
}
"""The columns of each pose; columns 2 to 4 are the flags, which are not used."""
NUMBERS_END = 10**9
"""Clouds have smaller numbers than this."""


@dataclass(frozen=True)
class KeyFrames:
    """A folder of SLAM runs, each a sequence."""

    ground_truth: Literal["rtk", "optimised_1", "optimised_2"] = "optimised_2"
    """Which poses are the ground truth; the odometry is the run's own."""
    body_T_lidar: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Pose of the clouds' frame in the body's (x forward, y left, z up): x, y, z in metres and
    roll, pitch, yaw in degrees."""
    lift_m: float = 0.0
    """Height of the body's origin above the ground, added to z."""

    def __post_init__(self) -> None:
        settings.check(self, "reader")
        log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        folder = root / sequence
        path = folder / FILE
        rows = log.read_table(path, COLUMNS)
        cloud_paths = _cloud_paths(folder, rows[:, NUMBER_COLUMN])
        is_on_disk = np.array([cloud_path.is_file() for cloud_path in cloud_paths])
        if not is_on_disk.any():
            raise LogError(f"{folder}: none of the {len(rows)} clouds that {FILE} names")
        skipped: Counter[str] = Counter()
        skipped["no such file"] += int((~is_on_disk).sum())
        rows = rows[is_on_disk]
        paths_on_disk = [cloud_paths[row] for row in np.flatnonzero(is_on_disk)]
        stamps_ns = log.to_nanoseconds(path, rows[:, STAMP_COLUMN], "s", 10**9)
        body_T_lidar = log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)
        lidar_T_body = np.linalg.inv(body_T_lidar)
        world_T_lidar = from_quaternions(path, rows[:, POSE_COLUMNS[self.ground_truth]])
        odom_T_lidar = from_quaternions(path, rows[:, POSE_COLUMNS["odometry"]])
        world_T_scan = log.lifted(world_T_lidar @ lidar_T_body, self.lift_m)
        odom_T_scan = log.lifted(odom_T_lidar @ lidar_T_body, self.lift_m)
        vehicle_T_lidar = log.raised(self.lift_m) @ body_T_lidar
        notes = vehicle.describe_faults(
            "the true poses", Trajectory(stamps_ns, world_T_scan, np.inf)
        )
        return Log(
            stamps_ns=stamps_ns,
            world_T_scan=world_T_scan,
            odom_T_scan=odom_T_scan,
            points=lambda row: read_scan(paths_on_disk[row], vehicle_T_lidar),
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        return {path.parent.name: [] for path in sorted(root.glob(f"*/{FILE}"))}


def _cloud_paths(folder: Path, numbers: NDArray[np.float64]) -> list[Path]:
    """The files of the clouds with these `numbers` (n,); raises LogError unless all are whole."""
    is_number = (numbers >= 0) & (numbers < NUMBERS_END) & (numbers == np.floor(numbers))
    wrong_rows = np.flatnonzero(~is_number)
    if len(wrong_rows):
        raise LogError(
            f"{folder / FILE}: row {wrong_rows[0] + 1} names cloud "
            f"{numbers[wrong_rows[0]]:g}; expected a whole number"
        )
    return [folder / f"{number:.0f}.pcd" for number in numbers]
