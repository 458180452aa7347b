"""Reads a CARMEN log of a robot with 2-D lasers as a Log (METHODS 7.5).

Freiburg and MIT published such logs. ROOT/NAME.log, .log.gz or .clf, or the same in a folder below
ROOT, is the sequence NAME. A corrected log has corrected poses, the ground truth, at its sweeps;
the odometry readings between two sweeps start at the corrected pose and drift from there, so their
steps are what the wheels measured. A raw log has the odometry at its sweeps; then a corrected log
beside it has the ground truth.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import LATEST_NS, Poses, Stamps, pose, transformed
from pipeline.core.settings import Positive, checked
from pipeline.formats import carmen
from pipeline.formats.carmen import Laser, Records, Sweep
from pipeline.readers import log
from pipeline.readers.log import Log

LIMIT_PARAMS: dict[Laser, str] = {"front": "robot_front_laser_max", "rear": "robot_rear_laser_max"}
"""The parameter of a log with the largest range of each laser."""
NEAR_LIMIT_M = 0.02
"""Ranges this near to the limit count as beyond it, since they are written with two digits."""


@dataclass(frozen=True)
@checked("reader")
class Carmen:
    """A folder of CARMEN logs."""

    lasers: Sequence[Laser] = ("front",)
    """The lasers whose sweeps are read."""
    corrected: str | None = None
    """The name of the corrected log beside a raw one, such as {sequence}.gfs.log. Its sweeps are
    matched by stamp, or by order where stamps stand still."""
    limit_m: float | None = None
    """Ranges in metres from here on are no hits; None: the log declares the limit."""
    lift_m: float = 7.0
    """Metres added to z: the height by which views of heights mark an occupied spot."""
    sweep_s: Positive = 1.0
    """Seconds between two sweeps of a log whose stamps stand still."""

    def __post_init__(self) -> None:
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
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        path = self._files(root).get(sequence)
        if path is None:
            raise LogError(f"{root / sequence}: no such log ({', '.join(carmen.SUFFIXES)})")
        records = carmen.read(path)
        sweeps = [
            sweep for sweep in records.sweeps if sweep.laser in self.lasers and len(sweep.ranges_m)
        ]
        other_count = len(records.sweeps) - len(sweeps)
        records.skipped["sweep of another laser, or without beams"] += other_count
        if not sweeps:
            raise LogError(
                f"{path}: no sweep of a {' or '.join(self.lasers)} laser; reader.lasers says which "
                "to read"
            )
        # stamps
        stamps = self._stamps(path, sweeps, records.skipped)
        sweeps = [sweeps[row] for row in stamps.rows]
        notes: list[str] = []
        if stamps.are_counted:
            notes.append(f"its stamps stand still: sweeps are counted, {self.sweep_s:g} s each")
        # poses
        is_raw = self.corrected is not None
        odom_T_scan = _odometry(records, sweeps, is_raw)
        world_T_scan = _planar([sweep.robot_pose for sweep in sweeps])
        if self.corrected is not None:
            corrected_path = path.with_name(self.corrected.format(sequence=sequence))
            world_T_scan = self._ground_truth(corrected_path, stamps, records.skipped)
        has_ground_truth: NDArray[np.bool_] = np.all(np.isfinite(world_T_scan), axis=(1, 2))
        log.refuse_poses(path, world_T_scan, has_ground_truth)
        posed_rows = np.flatnonzero(has_ground_truth | np.isfinite(odom_T_scan).all(axis=(1, 2)))
        # ranges
        limits_m = [self._limit_m(records, sweep) for sweep in sweeps]
        far_count = sum(
            int((sweep.ranges_m >= limit_m).sum())
            for sweep, limit_m in zip(sweeps, limits_m, strict=True)
        )
        if far_count:
            beam_count = sum(len(sweep.ranges_m) for sweep in sweeps)
            notes.append(
                f"{far_count} of {beam_count} ranges reached the laser's limit of "
                f"{max(limits_m):.2f} m: no hits"
            )
        if not is_raw and not _repeats_poses(records, sweeps):
            notes.append(
                "no reading of the odometry repeats a sweep's pose: is it a raw log? Then "
                "reader.corrected names the log of its ground truth"
            )

        def points(row: int) -> NDArray[np.float64]:
            return sweep_points(sweeps[posed_rows[row]], limits_m[posed_rows[row]], self.lift_m)

        return Log(
            stamps_ns=stamps.stamps_ns[posed_rows],
            world_T_scan=world_T_scan[posed_rows],
            odom_T_scan=odom_T_scan[posed_rows],
            points=points,
            skipped=+records.skipped,  # without the reasons that were counted as 0
            notes=tuple(notes),
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        missing: dict[str, list[str]] = {}
        for name, path in sorted(self._files(root).items()):
            missing[name] = []
            if self.corrected:
                ground_truth_path = path.with_name(self.corrected.format(sequence=name))
                if not ground_truth_path.is_file():
                    missing[name].append(ground_truth_path.name)
        return missing

    def _files(self, root: Path) -> dict[str, Path]:
        """The logs below the root by their names; corrected logs beside raw ones are left out."""
        logs: dict[str, Path] = {}
        for suffix in carmen.SUFFIXES:
            for place in ("*/*", "*"):
                for path in root.glob(place + suffix):
                    if path.is_file():
                        logs[path.name.removesuffix(suffix)] = path
        corrected_names = set()
        if self.corrected:
            corrected_names = {self.corrected.format(sequence=name) for name in logs}
        return {name: path for name, path in logs.items() if path.name not in corrected_names}

    def _stamps(self, path: Path, sweeps: Sequence[Sweep], skipped: Counter[str]) -> "_SweepStamps":
        """The stamps of the sweeps; counts in `skipped` those that do not increase."""
        stamps_s = np.array([sweep.stamp_s for sweep in sweeps])
        if not (np.abs(stamps_s) < LATEST_NS / 1e9).all():
            raise LogError(
                f"{path}: a sweep is stamped {stamps_s[np.abs(stamps_s).argmax()]:g}, which is no "
                "time in s"
            )
        stamps_ns = np.rint(stamps_s * 1e9).astype(np.int64)
        latest_before = np.maximum.accumulate(np.concatenate([[stamps_ns[0] - 1], stamps_ns[:-1]]))
        increasing_rows = np.flatnonzero(stamps_ns > latest_before)
        # not only where all stand still: some logs write seconds since 1970 with six digits
        if len(increasing_rows) <= len(sweeps) / 2:
            rows = np.arange(len(sweeps))
            counted_ns = np.rint(rows * self.sweep_s * 1e9).astype(np.int64)
            return _SweepStamps(counted_ns, rows, are_counted=True)
        skipped["stamp of an earlier one"] += len(sweeps) - len(increasing_rows)
        return _SweepStamps(stamps_ns[increasing_rows], increasing_rows, are_counted=False)

    def _ground_truth(self, path: Path, stamps: "_SweepStamps", skipped: Counter[str]) -> Poses:
        """The poses (sweep, 4, 4) in the corrected log `path`; NaN for a sweep that it lacks."""
        sweeps = [sweep for sweep in carmen.read(path).sweeps if sweep.laser in self.lasers]
        poses = _planar([sweep.robot_pose for sweep in sweeps])
        count = len(stamps.stamps_ns)
        if stamps.are_counted:
            if len(sweeps) != count:
                raise LogError(
                    f"{path}: {len(sweeps)} corrected poses for {count} sweeps without stamps"
                )
            return poses
        # by whole milliseconds, since the two logs may round their stamps differently
        row_by_ms = {round(sweep.stamp_s * 1e3): row for row, sweep in enumerate(sweeps)}
        world_T_scan = np.full((count, 4, 4), np.nan)
        matched_count = 0
        for scan, stamp_ns in enumerate(stamps.stamps_ns.tolist()):
            row = row_by_ms.get(round(stamp_ns / 1e6))
            if row is not None:
                world_T_scan[scan] = poses[row]
                matched_count += 1
        skipped["no corrected pose"] += count - matched_count
        if not matched_count:
            raise LogError(f"{path}: no corrected pose has the stamp of a sweep")
        return world_T_scan

    def _limit_m(self, records: Records, sweep: Sweep) -> float:
        """The range in metres from which on a beam of the sweep has no hit; inf where unknown."""
        if self.limit_m is not None:
            return self.limit_m
        limit_m = sweep.limit_m
        if np.isnan(limit_m):
            try:
                limit_m = float(records.params.get(LIMIT_PARAMS[sweep.laser], "nan"))
            except ValueError:
                limit_m = np.nan
        return limit_m - NEAR_LIMIT_M if limit_m > NEAR_LIMIT_M else np.inf


class _SweepStamps(NamedTuple):
    """The stamps of the sweeps of a log."""

    stamps_ns: Stamps
    """(n,) strictly increasing."""
    rows: NDArray[np.int64]
    """(n,) the sweep of each stamp."""
    are_counted: bool
    """Whether the log's own stamps stand still, so that the sweeps are counted instead."""


def sweep_points(sweep: Sweep, limit_m: float, lift_m: float) -> NDArray[np.float64]:
    """The hits (n, 3) of a sweep in metres, in the robot's frame: x forward, y left, z `lift_m`."""
    is_hit = (sweep.ranges_m > 0) & (sweep.ranges_m < limit_m)
    ranges_m = sweep.ranges_m[is_hit]
    angles_rad = sweep.angles_rad[is_hit]
    laser_xy_m = np.column_stack([ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)])
    robot_T_laser = np.linalg.inv(_planar([sweep.robot_pose])[0]) @ _planar([sweep.laser_pose])[0]
    xy_m = transformed(robot_T_laser, laser_xy_m)
    return np.column_stack([xy_m, np.full(len(xy_m), lift_m)])


def _odometry(records: Records, sweeps: Sequence[Sweep], is_raw: bool) -> Poses:
    """Poses (sweep, 4, 4) by the wheels alone, from the first reading on; NaN before it."""
    # In a raw log the poses of the sweeps are the odometry. In a corrected one they are the ground
    # truth, and the reading that follows a sweep repeats its pose: the step to that reading is a
    # correction, not a motion, so it is left out.
    if is_raw:
        return _planar([sweep.robot_pose for sweep in sweeps])
    if not records.odometry:
        return np.full((len(sweeps), 4, 4), np.nan)
    readings = _planar(records.odometry)
    steps = [np.eye(4)]
    steps += [np.linalg.inv(before) @ after for before, after in pairwise(readings)]
    corrections = {sweep.odometry for sweep in records.sweeps}  # of either laser
    start_T_robot = np.eye(4)
    poses = np.full((len(readings) + 1, 4, 4), np.nan)  # after so many readings
    for reading, step in enumerate(steps):
        if reading not in corrections:
            start_T_robot = start_T_robot @ step
        poses[reading + 1] = start_T_robot
    return poses[[sweep.odometry for sweep in sweeps]]


def _repeats_poses(records: Records, sweeps: Sequence[Sweep]) -> bool:
    """Whether the reading of the odometry after a sweep repeats its pose, as in corrected logs."""
    pairs = [
        (sweep, records.odometry[sweep.odometry])
        for sweep in sweeps
        if sweep.odometry < len(records.odometry)
    ]
    return not pairs or any(
        np.allclose(sweep.robot_pose, reading, atol=1e-4) for sweep, reading in pairs
    )


def _planar(xy_heading: Sequence[NDArray[np.float64]]) -> Poses:
    """Poses (n, 4, 4) from rows (n, 3) of x, y in metres and heading in radians."""
    rows = np.reshape(xy_heading, (-1, 3))
    zeros = np.zeros(len(rows))
    return pose(np.column_stack([rows[:, :2], zeros]), np.column_stack([zeros, zeros, rows[:, 2]]))
