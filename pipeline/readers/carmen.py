"""Reads CARMEN logs of a robot with 2-D lasers, as published by Freiburg and MIT (METHODS 7.5).

ROOT/NAME.log, .log.gz or .clf, or the same in a folder below ROOT, is the sequence NAME. Its sweeps
carry corrected poses, the truth; the odometry readings between them jump to each corrected pose and
drift from there: their steps are what wheels measured.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Poses, Stamps, pose
from pipeline.core.settings import Positive, check
from pipeline.formats import carmen
from pipeline.formats.carmen import Laser, Records, Sweep
from pipeline.readers import log
from pipeline.readers.log import Log

LIMIT_PARAMS: dict[Laser, str] = {"front": "robot_front_laser_max", "rear": "robot_rear_laser_max"}
NEAR_LIMIT_M = 0.02
"""Ranges this near to the limit count as beyond it, since they are written with two digits."""


@dataclass(frozen=True)
class Carmen:
    """A folder of CARMEN logs."""

    lasers: Sequence[Laser] = ("front",)
    corrected: str | None = None
    """The corrected log beside a raw one, such as {sequence}.gfs.log; matched by stamp, or by order
    where stamps stand still."""
    limit_m: float | None = None
    """Ranges in metres from here on are no hits; None: as the log declares it."""
    lift_m: float = 7.0
    """Metres added to z: the height that stands for an occupied spot."""
    sweep_s: Positive = 1.0
    """Seconds between two sweeps of a log whose stamps stand still."""

    def __post_init__(self) -> None:
        check(self, "reader")
        if not self.lasers or not set(self.lasers) <= {"front", "rear"}:
            raise ConfigError(f"reader.lasers={list(self.lasers)}: expected front, rear or both")
        if self.corrected is not None and (
            "/" in self.corrected or not self.corrected.endswith(carmen.SUFFIXES)
        ):
            raise ConfigError(
                f"reader.corrected={self.corrected}: expected the name of a corrected log; "
                ".relations hold no poses"
            )

    def open(self, root: Path, sequence: str) -> Log:
        path = self._files(root).get(sequence)
        if path is None:
            raise LogError(f"{root / sequence}: no such log ({', '.join(carmen.SUFFIXES)})")
        records = carmen.read(path)
        sweeps = [
            sweep for sweep in records.sweeps if sweep.laser in self.lasers and len(sweep.ranges_m)
        ]
        records.skipped["sweep of another laser, or without beams"] += len(records.sweeps) - len(
            sweeps
        )
        if not sweeps:
            raise LogError(
                f"{path}: no sweep of a {' or '.join(self.lasers)} laser; reader.lasers says which "
                "to read"
            )
        stamps_ns, order, notes = self._stamps(path, sweeps, records.skipped)
        sweeps = [sweeps[row] for row in order]
        odom_T_scan = _odometry(records, sweeps, raw=self.corrected is not None)
        world_T_scan = _planar([sweep.robot_pose for sweep in sweeps])
        if self.corrected is not None:
            corrected_path = path.with_name(self.corrected.format(sequence=sequence))
            world_T_scan = self._truth(corrected_path, stamps_ns, bool(notes), records.skipped)
        placed: NDArray[np.bool_] = np.all(np.isfinite(world_T_scan), axis=(1, 2))
        log.refuse_poses(path, world_T_scan, placed)
        limits_m = [self._limit_m(records, sweep) for sweep in sweeps]
        beyond_limit = sum(
            int((sweep.ranges_m >= limit_m).sum())
            for sweep, limit_m in zip(sweeps, limits_m, strict=True)
        )
        beams = sum(len(sweep.ranges_m) for sweep in sweeps)
        if beyond_limit:
            notes += (
                f"{beyond_limit} of {beams} ranges reached the laser's limit of "
                f"{max(limits_m):.2f} m: no hits",
            )
        if self.corrected is None and not _repeated(records, sweeps):
            notes += (
                "no reading of the odometry repeats a sweep's pose: is it a raw log? Then "
                "reader.corrected names its truth",
            )
        posed_rows = np.flatnonzero(placed | np.isfinite(odom_T_scan).all(axis=(1, 2)))

        def points(row: int) -> NDArray[np.float64]:
            return sweep_points(sweeps[posed_rows[row]], limits_m[posed_rows[row]], self.lift_m)

        return Log(
            stamps_ns[posed_rows],
            world_T_scan[posed_rows],
            odom_T_scan[posed_rows],
            points,
            +records.skipped,
            notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        logs = sorted(self._files(root).items())
        truth_paths = {
            name: path.with_name((self.corrected or path.name).format(sequence=name))
            for name, path in logs
        }
        return {name: [] if path.is_file() else [path.name] for name, path in truth_paths.items()}

    def _files(self, root: Path) -> dict[str, Path]:
        """The logs below the root by their names; those of corrected poses are no sequences."""
        paths = [
            (end, path)
            for end in carmen.SUFFIXES
            for place in ("*/*", "*")
            for path in root.glob(place + end)
        ]
        logs = {path.name.removesuffix(end): path for end, path in paths if path.is_file()}
        corrected = (
            {self.corrected.format(sequence=name) for name in logs} if self.corrected else set()
        )
        return {name: path for name, path in logs.items() if path.name not in corrected}

    def _stamps(
        self, path: Path, sweeps: Sequence[Sweep], skipped: Counter[str]
    ) -> tuple[Stamps, NDArray[np.int64], tuple[str, ...]]:
        """Increasing stamps (n,) in ns, the rows (n,) of their sweeps, and notes for the user."""
        stamps_s = np.array([sweep.stamp_s for sweep in sweeps])
        if not (np.abs(stamps_s) < log.LATEST_NS / 1e9).all():
            raise LogError(
                f"{path}: a sweep is stamped {stamps_s[np.abs(stamps_s).argmax()]:g}, which is no "
                "time in s"
            )
        stamps_ns = np.rint(stamps_s * 1e9).astype(np.int64)
        latest = np.maximum.accumulate(np.concatenate([[stamps_ns[0] - 1], stamps_ns[:-1]]))
        fresh = np.flatnonzero(stamps_ns > latest)
        # also where they stand still in part: some logs write seconds with six digits
        if len(fresh) <= len(sweeps) / 2:
            counted_ns = np.rint(np.arange(len(sweeps)) * self.sweep_s * 1e9).astype(np.int64)
            return (
                counted_ns,
                np.arange(len(sweeps)),
                (f"its stamps stand still: sweeps are counted, {self.sweep_s:g} s each",),
            )
        skipped["stamp of an earlier one"] += len(sweeps) - len(fresh)
        return stamps_ns[fresh], fresh, ()

    def _truth(self, path: Path, stamps_ns: Stamps, by_order: bool, skipped: Counter[str]) -> Poses:
        """Corrected poses (sweep, 4, 4) of a second file; NaN where it has none."""
        sweeps = [sweep for sweep in carmen.read(path).sweeps if sweep.laser in self.lasers]
        poses = _planar([sweep.robot_pose for sweep in sweeps])
        if by_order:
            if len(sweeps) != len(stamps_ns):
                raise LogError(
                    f"{path}: {len(sweeps)} corrected poses for {len(stamps_ns)} sweeps without "
                    "stamps"
                )
            return poses
        rows = {round(sweep.stamp_s * 1e3): row for row, sweep in enumerate(sweeps)}
        pose_rows = [rows.get(round(stamp / 1e6)) for stamp in stamps_ns.tolist()]
        skipped["no corrected pose"] += pose_rows.count(None)
        if not any(row is not None for row in pose_rows):
            raise LogError(f"{path}: no corrected pose has the stamp of a sweep")
        return np.stack(
            [np.full((4, 4), np.nan) if row is None else poses[row] for row in pose_rows]
        )

    def _limit_m(self, records: Records, sweep: Sweep) -> float:
        """The range in metres from which on a beam of the sweep has no hit; inf where unknown."""
        if self.limit_m is not None:
            return self.limit_m
        declared = sweep.limit_m
        if np.isnan(declared):
            try:
                declared = float(records.params.get(LIMIT_PARAMS[sweep.laser], "nan"))
            except ValueError:
                declared = np.nan
        return declared - NEAR_LIMIT_M if declared > NEAR_LIMIT_M else np.inf


def sweep_points(sweep: Sweep, limit_m: float, lift_m: float) -> NDArray[np.float64]:
    """The hits (n, 3) of a sweep in metres, in the robot's frame: x forward, y left, z `lift_m`."""
    hit = (sweep.ranges_m > 0) & (sweep.ranges_m < limit_m)
    ranges_m = sweep.ranges_m[hit]
    angles_rad = sweep.angles_rad[hit]
    robot_T_laser = np.linalg.inv(_planar([sweep.robot_pose])[0]) @ _planar([sweep.laser_pose])[0]
    across = np.column_stack([ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)])
    xy_m = across @ robot_T_laser[:2, :2].T + robot_T_laser[:2, 3]
    return np.column_stack([xy_m, np.full(len(xy_m), lift_m)])


def _planar(xy_heading: Sequence[NDArray[np.float64]]) -> Poses:
    """Poses (n, 4, 4) of x, y in metres and heading in radians (n, 3)."""
    rows = np.reshape(xy_heading, (-1, 3))
    zeros = np.zeros(len(rows))
    return pose(np.column_stack([rows[:, :2], zeros]), np.column_stack([zeros, zeros, rows[:, 2]]))


def _repeated(records: Records, sweeps: Sequence[Sweep]) -> bool:
    """Whether a reading of the odometry repeats the pose of a sweep, as in corrected logs.

    True where there is no odometry.
    """
    pairs = [
        (sweep, records.odometry[sweep.odometry])
        for sweep in sweeps
        if sweep.odometry < len(records.odometry)
    ]
    return not pairs or any(
        np.allclose(sweep.robot_pose, reading, atol=1e-4) for sweep, reading in pairs
    )


def _odometry(records: Records, sweeps: Sequence[Sweep], raw: bool) -> Poses:
    """Poses (sweep, 4, 4) by the wheels alone, from the first reading on; NaN before it.

    In a raw log the sweeps' own poses are readings too. In a corrected one they are the truth, and
    the reading that follows repeats it: that step is the correction, not the robot's.
    """
    if raw:
        return _planar([sweep.robot_pose for sweep in sweeps])
    if not records.odometry:
        return np.full((len(sweeps), 4, 4), np.nan)
    readings = _planar(records.odometry)
    corrections = {sweep.odometry for sweep in records.sweeps}  # of either laser
    steps = [np.eye(4), *(np.linalg.inv(a) @ b for a, b in pairwise(readings))]
    travelled = np.full((len(readings) + 1, 4, 4), np.nan)
    start_T_robot = np.eye(4)
    for row, step in enumerate(steps):
        if row not in corrections:
            start_T_robot = start_T_robot @ step
        travelled[row + 1] = start_T_robot
    return travelled[[sweep.odometry for sweep in sweeps]]
