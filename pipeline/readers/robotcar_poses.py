"""Reads the poses of Oxford RobotCar from its csv files (METHODS 7.2).

There are three kinds: visual odometry (vo.csv), inertial navigation (ins.csv), which is the ground
truth, and the poses of the sensors in the vehicle (extrinsics). The frames in the files are z-down;
the trajectories are of the z-up vehicle, whose origin is the stereo camera.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, Stamps, Trajectory, flip_ned, pose
from pipeline.formats import robotcar
from pipeline.readers import log
from pipeline.readers.columns import read_columns, to_numbers, utimes_ns

LARGEST_NUMBER = 1e9
"""Limit in metres and radians: a larger number is damage."""


@dataclass(frozen=True)
class Odometry:
    """Visual odometry: motions between images, chained into poses.

    The chain begins at the identity and starts again after each break.
    """

    trajectory: Trajectory
    breaks_ns: Stamps
    """(break,) the stamp of the last pose before each break."""

    def at(self, stamps_ns: Stamps, has_ground_truth: NDArray[np.bool_]) -> Poses:
        """Poses (m, 4, 4) at increasing `stamps_ns` (m,), NaN where unknown.

        `has_ground_truth` (m,) is True for rows with a true pose. After a break all rows are NaN up
        to and including the first of these: the log drops rows that have neither pose, but keeps
        this one, whose NaN marks the break.
        """
        poses, _ = self.trajectory.at(stamps_ns)
        # the end counts too, for a break after which no row has a true pose
        rows_with_ground_truth = np.append(np.flatnonzero(has_ground_truth), len(has_ground_truth))
        for first_row in np.searchsorted(stamps_ns, self.breaks_ns, side="right"):
            last_row = rows_with_ground_truth[np.searchsorted(rows_with_ground_truth, first_row)]
            poses[first_row : last_row + 1] = np.nan
        return poses


def read_vo(path: Path, max_gap_s: float) -> Odometry:
    """Read vo.csv, whose rows hold the vehicle's motion from one image to the next.

    In the file's words a row leads from its destination, the earlier image, to its source:
    pose(source) = pose(destination) · motion. A row whose destination is not the source of the row
    before is a break. Raises LogError naming a row whose destination is not before its source, or
    whose source does not increase.
    """
    table = read_columns(path, robotcar.VO_COLUMNS)
    to_utime, from_utime = to_numbers(path, table, robotcar.VO_STAMPS).T
    motions = to_numbers(path, table, robotcar.POSE)
    is_step = (from_utime >= 0) & (from_utime < to_utime) & (from_utime == np.floor(from_utime))
    bad_rows = np.flatnonzero(~is_step)
    if len(bad_rows):
        row = bad_rows[0]
        raise LogError(
            f"{path}: row {row + 1} goes from destination_timestamp {from_utime[row]:.16g} "
            f"to source_timestamp {to_utime[row]:.16g}; expected whole µs, the destination "
            "before the source"
        )
    bad_rows = np.flatnonzero(~(np.abs(motions) < LARGEST_NUMBER).all(axis=1))
    if len(bad_rows):
        raise LogError(
            f"{path}: row {bad_rows[0] + 1} holds no pose; expected six finite numbers: x, y, z, "
            "roll, pitch, yaw"
        )
    to_stamps_ns = utimes_ns(path, to_utime).tolist()
    from_stamps_ns = (from_utime.astype(np.int64) * 1000).tolist()
    from_T_to = flip_ned(pose(*np.hsplit(motions, 2)))
    # chain the motions; a break puts a NaN pose 1 ns after the last one, then the identity again
    stamps_ns = [from_stamps_ns[0]]
    poses = [np.eye(4)]
    breaks_ns = []
    for to_ns, from_ns, motion in zip(to_stamps_ns, from_stamps_ns, from_T_to, strict=True):
        if from_ns != stamps_ns[-1]:
            breaks_ns.append(stamps_ns[-1])
            start_ns = from_ns if from_ns > stamps_ns[-1] else to_ns
            stamps_ns += [stamps_ns[-1] + 1, start_ns]
            poses += [np.full((4, 4), np.nan), np.eye(4)]
        if to_ns > stamps_ns[-1]:
            stamps_ns.append(to_ns)
            poses.append(poses[-1] @ motion)
    trajectory = Trajectory(np.array(stamps_ns), np.array(poses), max_gap_s)
    return Odometry(trajectory, np.array(breaks_ns, np.int64))


def read_ins(path: Path, vehicle_T_ins: NDArray[np.float64], max_gap_s: float) -> Trajectory:
    """Read ins.csv as a trajectory of the vehicle in the world x north, y west, z up.

    Rows whose status is not INS_SOLUTION_GOOD are gaps. `vehicle_T_ins` (4, 4) is between the
    z-down frames, as `read_extrinsics` returns it. Raises LogError for several UTM zones.
    """
    table = read_columns(path, ("timestamp", "ins_status", "utm_zone", *robotcar.INS_POSE))
    stamps_ns = utimes_ns(path, to_numbers(path, table, ("timestamp",))[:, 0])
    rows = to_numbers(path, table, robotcar.INS_POSE)
    has_good_status = np.array(table["ins_status"]) == robotcar.INS_GOOD
    is_good = has_good_status & (np.abs(rows) < LARGEST_NUMBER).all(axis=1)
    zones = sorted(set(np.array(table["utm_zone"])[is_good]))
    if len(zones) > 1:
        raise LogError(
            f"{path}: rows of the UTM zones {', '.join(zones)[:60]}, which have no common frame; "
            "expected one zone"
        )
    ned_T_vehicle = pose(*np.hsplit(rows[is_good], 2)) @ np.linalg.inv(vehicle_T_ins)
    world_T_vehicle = np.full((len(rows), 4, 4), np.nan)
    world_T_vehicle[is_good] = flip_ned(ned_T_vehicle)
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
    rows = log.read_table(path, 6)
    if len(rows) != 1 or not (np.abs(rows) < LARGEST_NUMBER).all():
        raise LogError(f"{path}: expected one row of six finite numbers: x, y, z, roll, pitch, yaw")
    return np.asarray(pose(*np.hsplit(rows, 2))[0])
