"""Reads a log of KITTI odometry, Velodyne scans with times and true poses, as a Log (METHODS 7.3).

Each log has a world frame of its own, so two logs cannot be compared. A study therefore trains on
the first split of one log, the sequence `00-a`, and tests on the second one, `00-b`; `00` is the
whole log.
"""

import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Stamps, Trajectory, travelled_m
from pipeline.core.settings import Positive, Share, checked
from pipeline.formats import kitti
from pipeline.readers import log, vehicle
from pipeline.readers.log import Log

POSES_PLACES = ("poses/{sequence}.txt", "sequences/{sequence}/poses.txt")
"""Where the poses of a log may lie below the root: KITTI's place, and SemanticKITTI's."""
MAX_GAP_S = 1.0
"""Between scans further apart than this, others are missing: the path is not checked for jumps."""


@dataclass(frozen=True)
@checked("reader")
class Kitti:
    """A KITTI odometry root with `sequences/` and `poses/`."""

    lidar_height_m: Positive = 1.73
    """Height of the Velodyne above the road, added to z."""
    split: Share = 0.5
    """Share of the path of a log that belongs to its split `-a`."""
    root_per_sequence: bool = False
    """Whether each sequence has a folder of its own with such a root inside, as in the simulated
    suburb."""
    poses: bool = True
    """False: all scans are taken, without true poses. The test logs 11 to 21 have none."""

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        root = root / sequence if self.root_per_sequence else root
        name, dash, split = sequence.partition("-")
        if split not in ("a", "b") and dash:
            raise ConfigError(
                f"sequence={sequence}: a KITTI sequence is a log, such as 00, or its split 00-a or "
                "00-b"
            )
        times_path = root / kitti.TIMES.format(log=name)
        stamps_ns = read_times(times_path)
        poses_path = log.first_file(root, POSES_PLACES, name) or root / kitti.POSES.format(log=name)
        poses = np.full((len(stamps_ns), 4, 4), np.nan)
        if self.poses:
            poses = read_poses(poses_path, root / kitti.CALIB.format(log=name))
        if len(stamps_ns) != len(poses):
            raise LogError(
                f"{times_path}: {len(stamps_ns)} times for {len(poses)} poses in {poses_path}"
            )
        folder = root / kitti.SCANS.format(log=name)
        skipped = Counter[str]()
        numbers = scan_numbers(folder, skipped)
        rows = numbers[numbers < len(poses)]
        skipped["outside the poses' span"] += len(numbers) - len(rows)
        if not len(rows):
            raise LogError(f"{folder}: holds no readable scan (NNNNNN.bin)")
        notes: tuple[str, ...] = ()
        if len(rows) < len(poses):
            notes += (f"{len(poses) - len(rows)} of {len(poses)} scans are not on disk",)
        if self.poses:
            notes += vehicle.describe_faults(
                "the true poses", Trajectory(stamps_ns, poses, MAX_GAP_S)
            )
        if split:
            path_m = travelled_m(poses[rows, :3, 3])
            is_in_a = path_m <= self.split * path_m[-1]
            rows = rows[is_in_a if split == "a" else ~is_in_a]
        world_T_scan = log.lifted(poses[rows], self.lidar_height_m)
        odom_T_scan = np.full_like(world_T_scan, np.nan)  # KITTI has no odometry

        def points(row: int) -> NDArray[np.float64]:
            return read_velodyne(folder / f"{rows[row]:06d}.bin", self.lidar_height_m)

        return Log(
            stamps_ns=stamps_ns[rows],
            world_T_scan=world_T_scan,
            odom_T_scan=odom_T_scan,
            points=points,
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        if not self.root_per_sequence:
            folders = root.glob("sequences/*/velodyne")
            names = sorted(path.parent.name for path in folders if path.is_dir())
            return {name: self._missing(root, name) for name in names}
        single_root = replace(self, root_per_sequence=False)
        folders = root.glob("*/sequences/*/velodyne")
        missing: dict[str, list[str]] = {}
        for sequence_root in sorted(path.parents[2] for path in folders if path.is_dir()):
            log_name = sequence_root.name.partition("-")[0]
            files = single_root.sequences(sequence_root).get(log_name)
            if files is not None:
                missing[sequence_root.name] = files
        return missing

    def _missing(self, root: Path, name: str) -> list[str]:
        """The files that a log lacks."""
        files = []
        if self.poses and log.first_file(root, POSES_PLACES, name) is None:
            files.append(kitti.POSES.format(log=name))
        places = (kitti.CALIB, kitti.TIMES) if self.poses else (kitti.TIMES,)
        needed_files = [place.format(log=name) for place in places]
        return files + [file for file in needed_files if not (root / file).is_file()]


def read_velodyne(path: str | Path, lift_m: float = 0.0) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one scan, raised by `lift_m`.

    The frame is x forward, y left, z up, with its origin in the sensor if not raised. Points that
    are not finite are dropped. Raises LogError for a missing file or one that ends within a record.
    """
    data = log.read_bytes(Path(path), kitti.RECORD_BYTES, "points")
    return np.asarray(kitti.decode(np.frombuffer(data, "<f4"), lift_m))


def read_poses(poses_path: str | Path, calib_path: str | Path) -> NDArray[np.float64]:
    """Poses (n, 4, 4) of the Velodyne in its first frame (METHODS 7.3).

    The file holds poses P of camera 0, and calib.txt the Velodyne's pose in the camera, Tr; the
    result is Tr⁻¹ P Tr. Raises LogError naming the row that is not a pose.
    """
    first_T_cam = read_camera_poses(Path(poses_path))
    cam_T_velo = read_calibration(Path(calib_path))
    return np.linalg.inv(cam_T_velo) @ first_T_cam @ cam_T_velo


def read_camera_poses(path: Path) -> NDArray[np.float64]:
    """Poses (n, 4, 4) of camera 0 in its first frame; raises LogError naming a row that is none."""
    rows = log.read_table(path, 12)
    first_T_cam = kitti.to_poses(rows)
    log.refuse_poses(path, first_T_cam, np.ones(len(rows), bool))
    return first_T_cam


def read_times(path: Path) -> Stamps:
    """The stamps (n,) in ns of times.txt; raises LogError naming a row that is no later time."""
    return log.to_nanoseconds(path, log.read_table(path, 1)[:, 0], "s", 10**9)


def read_calibration(path: Path) -> NDArray[np.float64]:
    """The Velodyne's pose (4, 4) in camera 0, from the row `Tr:` of calib.txt.

    Raises LogError for a file without that row, or a row that is no pose.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, UnicodeDecodeError):
        raise LogError(f"{path}: no readable calibration there") from None
    row = next((line.partition(":")[2].split() for line in lines if line.startswith("Tr:")), [])
    try:
        numbers = np.array([float(number) for number in row])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (12,) or not np.isfinite(numbers).all():
        raise LogError(
            f"{path}: expected a row 'Tr:' with 12 numbers, the camera's frame from the Velodyne's"
        )
    cam_T_velo: NDArray[np.float64] = kitti.to_poses(numbers[None])[0]
    R = cam_T_velo[:3, :3].clip(-2, 2)  # no number that could overflow below
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
        raise LogError(
            f"{path}: the first three columns of 'Tr:' are no rotation; fetch the file again"
        )
    return cam_T_velo


def scan_numbers(folder: Path, skipped: Counter[str]) -> NDArray[np.int64]:
    """The numbers (n,) of the whole scans of a folder velodyne/, from 0.

    Counts the other files in `skipped`. Raises LogError if there is no scan.
    """
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder of scans")
    is_number = re.compile("[0-9]{6}").fullmatch
    reason = "file name is no scan number"
    files = log.numbered_files(folder, kitti.RECORD_BYTES, is_number, reason, skipped)
    if not len(files.usable):
        raise LogError(f"{folder}: holds no readable scan (NNNNNN.bin)")
    return files.usable
