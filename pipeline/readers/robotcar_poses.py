"""Reads the poses of Oxford RobotCar (METHODS 7.2).

They are visual odometry, inertial navigation and the extrinsics of the sensors. The frames in the
files are z-down; the trajectories are of the z-up vehicle, whose origin is the stereo camera.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, Stamps, Trajectory, flip_ned, pose
from pipeline.formats import robotcar
from pipeline.readers import log
from pipeline.readers.columns import columns, numbers, utimes_ns

LARGEST = 1e9
"""Limit in metres and radians: a larger number is damage."""


@dataclass(frozen=True)
class Odometry:
    """Relative poses chained from the identity, where the chain starts anew after a break."""

    trajectory: Trajectory
    breaks_ns: Stamps
    """(break,) the stamp of the last pose before each break."""

    def at(self, stamps_ns: Stamps, placed: NDArray[np.bool_]) -> Poses:
        """Poses (m, 4, 4) at `stamps_ns`, NaN where unknown.

        `placed` (m,) marks the rows with a true pose, which stay in the log even without odometry.
        After a break all rows up to and including the first of these are NaN, so that the log keeps
        one NaN row for each break.
        """
        poses = self.trajectory.at(stamps_ns)[0]
        staying = np.append(np.flatnonzero(placed), len(placed))
        for after in np.searchsorted(stamps_ns, self.breaks_ns, side="right"):
            poses[after : staying[np.searchsorted(staying, after)] + 1] = np.nan
        return poses


def read_vo(path: Path, max_gap_s: float) -> Odometry:
    """Read vo.csv: pose(source) = pose(destination) · T(row).

    A destination other than the previous source is a break. Raises LogError naming a row whose
    destination is not before its source, or whose source does not increase.
    """
    table = columns(path, robotcar.VO_COLUMNS)
    source, before = numbers(path, table, robotcar.VO_STAMPS).T
    steps = numbers(path, table, robotcar.POSE)
    bad = np.flatnonzero(~((before >= 0) & (before < source) & (before == np.floor(before))))
    if len(bad):
        raise LogError(
            f"{path}: row {bad[0] + 1} goes from destination_timestamp {before[bad[0]]:.16g} to "
            f"source_timestamp {source[bad[0]]:.16g}; expected whole µs, the destination before "
            "the source"
        )
    bad = np.flatnonzero(~(np.abs(steps) < LARGEST).all(axis=1))
    if len(bad):
        raise LogError(
            f"{path}: row {bad[0] + 1} holds no pose; expected six finite numbers: x, y, z, roll, "
            "pitch, yaw"
        )
    sources_ns = utimes_ns(path, source).tolist()
    befores_ns = (before.astype(np.int64) * 1000).tolist()
    before_T_source = flip_ned(pose(*np.hsplit(steps, 2)))
    stamps_ns = [befores_ns[0]]
    poses = [np.eye(4)]
    breaks_ns = []
    for source_ns, before_ns, step in zip(sources_ns, befores_ns, before_T_source, strict=True):
        if before_ns != stamps_ns[-1]:
            breaks_ns.append(stamps_ns[-1])
            start_ns = before_ns if before_ns > stamps_ns[-1] else source_ns
            stamps_ns += [stamps_ns[-1] + 1, start_ns]
            poses += [np.full((4, 4), np.nan), np.eye(4)]
        if source_ns > stamps_ns[-1]:
            stamps_ns.append(source_ns)
            poses.append(poses[-1] @ step)
    return Odometry(
        Trajectory(np.array(stamps_ns), np.array(poses), max_gap_s), np.array(breaks_ns, np.int64)
    )


def read_ins(path: Path, vehicle_T_ins: NDArray[np.float64], max_gap_s: float) -> Trajectory:
    """Read ins.csv as a trajectory of the vehicle in the world x north, y west, z up.

    Rows not INS_SOLUTION_GOOD are gaps. `vehicle_T_ins` (4, 4) is between the z-down frames, as
    `read_extrinsics` returns it. Raises LogError for several UTM zones.
    """
    table = columns(path, ("timestamp", "ins_status", "utm_zone", *robotcar.INS_POSE))
    stamps_ns = utimes_ns(path, numbers(path, table, ("timestamp",))[:, 0])
    rows = numbers(path, table, robotcar.INS_POSE)
    good = (np.array(table["ins_status"]) == robotcar.INS_GOOD) & (np.abs(rows) < LARGEST).all(
        axis=1
    )
    zones = sorted(set(np.array(table["utm_zone"])[good]))
    if len(zones) > 1:
        raise LogError(
            f"{path}: rows of the UTM zones {', '.join(zones)[:60]}, which have no common frame; "
            "expected one zone"
        )
    world_T_vehicle = np.full((len(rows), 4, 4), np.nan)
    world_T_vehicle[good] = flip_ned(pose(*np.hsplit(rows[good], 2)) @ np.linalg.inv(vehicle_T_ins))
    return Trajectory(stamps_ns, world_T_vehicle, max_gap_s)


def read_extrinsics(folder: Path, sensor: str) -> NDArray[np.float64]:
    """vehicle_T_sensor (4, 4) of the z-down vehicle, from SENSOR.txt of the SDK's extrinsics.

    Raises LogError for a missing or damaged file.
    """
    path = folder / f"{sensor}.txt"
    if not path.is_file():
        raise LogError(
            f"{path}: no such file; copy the folder `extrinsics` of the data set's SDK "
            "(robotcar-dataset-sdk) there"
        )
    rows = log.table(path, 6)
    if len(rows) != 1 or not (np.abs(rows) < LARGEST).all():
        raise LogError(f"{path}: expected one row of six finite numbers: x, y, z, roll, pitch, yaw")
    return np.asarray(pose(*np.hsplit(rows, 2))[0])
