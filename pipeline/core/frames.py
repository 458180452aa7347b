"""Coordinate frames: computes with 4×4 poses, and interpolates trajectories at any stamp.

`a_T_b` maps b-coordinates into a: p_a = a_T_b @ p_b. World and vehicle frames are x forward, y
left, z up unless a name says otherwise; `ned` is x forward (north), y right (east), z down.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # loads a part of it when that is first used: most stages need none
from numpy.typing import NDArray

from pipeline.core.errors import InputError

Poses = NDArray[np.float64]
"""Poses as matrices (n, 4, 4), or one (4, 4): a rotation and a position in metres."""
Stamps = NDArray[np.int64]
"""Stamps (n,) in nanoseconds since 1970-01-01."""

NED_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Maps a z-up frame to a north-east-down one and back: y and z change sign."""


def pose(xyz_m: NDArray[np.float64], rpy_rad: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) from positions (n, 3) and roll, pitch, yaw (n, 3).

    R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    poses = np.tile(np.eye(4), (len(xyz_m), 1, 1))
    poses[:, :3, :3] = scipy.spatial.transform.Rotation.from_euler("xyz", rpy_rad).as_matrix()
    poses[:, :3, 3] = xyz_m
    return poses


def rpy(poses: Poses) -> NDArray[np.float64]:
    """Roll, pitch, yaw (n, 3) in radians of poses (n, 4, 4)."""
    return scipy.spatial.transform.Rotation.from_matrix(poses[:, :3, :3]).as_euler("xyz")


def yaw(poses: Poses) -> NDArray[np.float64]:
    """Headings (n,) of poses (n, 4, 4): the x axis in the xy plane, radians counter-clockwise.

    One pose (4, 4), or (3, 3) of a plane, has one heading.
    """
    return np.arctan2(poses[..., 1, 0], poses[..., 0, 0])


def wrapped_deg(angles_deg: NDArray[Any]) -> NDArray[Any]:
    """Angles in degrees, of any shape, brought into (−180, 180]."""
    return np.asarray(180 - (180 - angles_deg) % 360)


def distance_and_turn(
    world_T_a: Poses, world_T_b: Poses
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances (n,) in metres and turns (n,) in degrees between two arrays of poses (n, 4, 4).

    Both are NaN where one of the poses is NaN. Of two single poses (4, 4) both are numbers.
    """
    distances_m = np.linalg.norm(world_T_a[..., :3, 3] - world_T_b[..., :3, 3], axis=-1)
    traces = np.einsum("...ij,...ij->...", world_T_a[..., :3, :3], world_T_b[..., :3, :3])
    turns_rad = np.arccos(((traces - 1) / 2).clip(-1, 1))  # trace R = 1 + 2 cos(turn)
    return distances_m, np.abs(np.rad2deg(turns_rad))  # the sign of arccos(NaN) is the processor's


def flip_ned(poses: Poses) -> Poses:
    """Convert poses (n, 4, 4) between north-east-down frames into poses between z-up ones, or back.

    A pose P becomes F P F, with F = diag(1, −1, −1, 1).
    """
    return NED_FLIP @ poses @ NED_FLIP


def turns(left_rad: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) of a robot that turned on the spot by angles (n,) to the left."""
    zeros = np.zeros(len(left_rad))
    rpy_rad = np.column_stack([zeros, zeros, left_rad])
    return pose(np.zeros((len(left_rad), 3)), rpy_rad)


def transformed(a_T_b: NDArray[np.float64], points_b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Points (n, 3), or (n, 2) of a plane, in metres, transformed from frame b into frame a.

    `a_T_b` is a pose (4, 4), or for points of a plane one of a plane (3, 3).
    """
    count = points_b.shape[1]
    return np.asarray(points_b @ a_T_b[:count, :count].T + a_T_b[:count, -1])


def step_lengths_m(positions_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """Metres (n − 1,) from each position (n, 2 or 3) to the next; NaN where one is NaN."""
    return np.asarray(np.linalg.norm(np.diff(positions_m, axis=0), axis=1))


def travelled_m(
    positions_m: NDArray[np.floating], is_step: NDArray[np.bool_] | bool = True
) -> NDArray[np.float64]:
    """Metres (n,) of path from the first of the positions (n, 2 or 3) to each: 2-D or 3-D as given.

    Steps to and from a NaN position count as 0, and so do those that are False in `is_step`
    (n − 1,).
    """
    steps_m = step_lengths_m(positions_m)
    counted_m = np.where(np.isfinite(steps_m) & is_step, steps_m, 0.0)
    return np.concatenate([[0.0], np.cumsum(counted_m)])[: len(positions_m)]


ROUNDED_NS = 1_000
"""Stamps that differ by at most a microsecond are equal: files of poses round stamps to that."""
LATEST_NS = 2**62
"""Stamps are 64-bit nanoseconds; a later one (after 2116) is damage."""
RIGHT_WITHIN = (2.0, 5.0)
"""Metres and degrees: a pose is right if it is off by less, as is usual in the field."""
LEVEL_RIGHT_WITHIN = (1.0, 10.0)
"""The same of the poses of level 2-D sweeps."""


@dataclass(frozen=True)
class Trajectory:
    """The poses of a body at increasing stamps; a row with a NaN is a gap, without a known pose."""

    stamps_ns: Stamps
    """(n,) strictly increasing."""
    world_T_body: Poses
    """(n, 4, 4)."""
    max_gap_s: float
    """No pose is interpolated between neighbouring rows that are further apart than this."""

    def __post_init__(self) -> None:
        if len(self.stamps_ns) != len(self.world_T_body):
            raise InputError(f"{len(self.stamps_ns)} stamps for {len(self.world_T_body)} poses")
        if (np.diff(self.stamps_ns) <= 0).any():
            raise InputError("the stamps of a trajectory must increase")

    def at(self, stamps_ns: Stamps) -> tuple[Poses, NDArray[np.bool_]]:
        """Poses (m, 4, 4) at `stamps_ns` (m,) and whether each is known (m,); unknown ones are NaN.

        A row within ROUNDED_NS of a stamp is its pose. Else the position is interpolated linearly
        and the rotation by slerp between the two rows around the stamp, but never across a gap and
        never beyond the ends.
        """
        poses = np.full((len(stamps_ns), 4, 4), np.nan)
        if not len(self.stamps_ns):
            return poses, np.zeros(len(stamps_ns), bool)
        has_pose: NDArray[np.bool_] = np.all(np.isfinite(self.world_T_body), axis=(1, 2))
        # the rows before and after each stamp
        after = np.searchsorted(self.stamps_ns, stamps_ns, side="left")
        after = after.clip(0, len(self.stamps_ns) - 1)
        before = (after - 1).clip(0)
        before_ns = self.stamps_ns[before]
        after_ns = self.stamps_ns[after]
        # stamps that are a row's own
        is_after_nearer = np.abs(after_ns - stamps_ns) <= np.abs(before_ns - stamps_ns)
        nearest = np.where(is_after_nearer, after, before)
        is_exact = np.abs(self.stamps_ns[nearest] - stamps_ns) <= ROUNDED_NS
        is_exact &= has_pose[nearest]
        poses[is_exact] = self.world_T_body[nearest[is_exact]]
        # stamps between two rows
        is_between = (before_ns < stamps_ns) & (stamps_ns < after_ns)
        is_between &= has_pose[before] & has_pose[after]
        is_between &= after_ns - before_ns <= self.max_gap_s * 1e9
        is_between &= ~is_exact
        if is_between.any():
            start_ns = before_ns[is_between]
            end_ns = after_ns[is_between]
            share = (stamps_ns[is_between] - start_ns) / (end_ns - start_ns)
            start = self.world_T_body[before[is_between]]
            end = self.world_T_body[after[is_between]]
            poses[is_between] = interpolate(start, end, share)
        return poses, is_exact | is_between


def interpolate(start: Poses, end: Poses, share: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) at a share (n,) of the way from the poses `start` to the poses `end`.

    With a share above 1 the motion goes on past `end` at the same rate.
    """
    Rotation = scipy.spatial.transform.Rotation
    turn = Rotation.from_matrix(start[:, :3, :3]).inv() * Rotation.from_matrix(end[:, :3, :3])
    poses = np.tile(np.eye(4), (len(share), 1, 1))
    part_of_turn = Rotation.from_rotvec(turn.as_rotvec() * share[:, None])
    poses[:, :3, :3] = (Rotation.from_matrix(start[:, :3, :3]) * part_of_turn).as_matrix()
    poses[:, :3, 3] = start[:, :3, 3] + share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
    return poses


def days_between(start_ns: int, end_ns: int) -> int:
    """Whole calendar days (UTC) from the date of one stamp to the date of another."""
    day_ns = 86_400 * 10**9
    return int(end_ns) // day_ns - int(start_ns) // day_ns
