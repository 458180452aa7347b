"""Coordinate frames: 4×4 poses, and trajectories asked at any moment.

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
Stamps = NDArray[np.int64]

NED_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


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
    """Heading of the x axis in the xy plane, (n,) in radians, counter-clockwise from +x."""
    return np.arctan2(poses[:, 1, 0], poses[:, 0, 0])


def wrapped_deg(angles_deg: NDArray[Any]) -> NDArray[Any]:
    """Angles in degrees, of any shape, brought into (−180, 180]."""
    return np.asarray(180 - (180 - angles_deg) % 360)


def distance_and_turn(
    world_T_a: Poses, world_T_b: Poses
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance (n,) in metres and turn (n,) in degrees between poses (n, 4, 4).

    NaN where a pose is.
    """
    away_m = np.linalg.norm(world_T_a[:, :3, 3] - world_T_b[:, :3, 3], axis=1)
    traces = np.einsum("nij,nij->n", world_T_a[:, :3, :3], world_T_b[:, :3, :3])
    return away_m, np.rad2deg(np.arccos(((traces - 1) / 2).clip(-1, 1)))


def flip_ned(poses: Poses) -> Poses:
    """Convert poses between two north-east-down frames into poses between the z-up ones, and back.

    F P F, with F = diag(1, −1, −1, 1).
    """
    return NED_FLIP @ poses @ NED_FLIP


def turns(left_rad: NDArray[np.float64]) -> Poses:
    """Rotations (n, 4, 4) of a robot to the left (n,) on the spot."""
    still = np.zeros((len(left_rad), 3))
    return pose(still, np.column_stack([still[:, :2], left_rad]))


def transform(a_T_b: NDArray[np.float64], points_b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Points (n, 3) of frame b in frame a, computed in float64."""
    return (points_b @ a_T_b[:3, :3].T + a_T_b[:3, 3]).astype(np.float32)


ROUNDED_NS = 1_000
"""Files of poses write stamps with six decimals of a second; a body does not move in a
microsecond."""


@dataclass(frozen=True)
class Trajectory:
    """A body's poses at increasing stamps; rows that hold a NaN are gaps."""

    stamps_ns: Stamps
    """(n,) strictly increasing."""
    world_T_body: Poses
    """(n, 4, 4)."""
    max_gap_s: float
    """Neighbouring rows further apart than this are a gap too."""

    def __post_init__(self) -> None:
        if len(self.stamps_ns) != len(self.world_T_body):
            raise InputError(f"{len(self.stamps_ns)} stamps for {len(self.world_T_body)} poses")
        if (np.diff(self.stamps_ns) <= 0).any():
            raise InputError("the stamps of a trajectory must increase")

    def at(self, stamps_ns: Stamps) -> tuple[Poses, NDArray[np.bool_]]:
        """Poses (m, 4, 4) at `stamps_ns` (m,) and whether each is known (m,); unknown ones are NaN.

        Positions are interpolated linearly, rotations by slerp, between the two rows around a
        stamp; never across a gap and never beyond the ends. A row within ROUNDED_NS of a stamp is
        its pose.
        """
        poses = np.full((len(stamps_ns), 4, 4), np.nan)
        if not len(self.stamps_ns):
            return poses, np.zeros(len(stamps_ns), bool)
        finite: NDArray[np.bool_] = np.all(np.isfinite(self.world_T_body), axis=(1, 2))
        after = np.searchsorted(self.stamps_ns, stamps_ns, side="left").clip(
            0, len(self.stamps_ns) - 1
        )
        before = (after - 1).clip(0)
        nearest = np.where(
            np.abs(self.stamps_ns[after] - stamps_ns) <= np.abs(self.stamps_ns[before] - stamps_ns),
            after,
            before,
        )
        exact = (np.abs(self.stamps_ns[nearest] - stamps_ns) <= ROUNDED_NS) & finite[nearest]
        poses[exact] = self.world_T_body[nearest[exact]]
        step_ns = self.stamps_ns[after] - self.stamps_ns[before]
        inside = (
            (self.stamps_ns[before] < stamps_ns)
            & (stamps_ns < self.stamps_ns[after])
            & finite[before]
            & finite[after]
        )
        between = inside & (step_ns <= self.max_gap_s * 1e9) & ~exact
        if between.any():
            a = before[between]
            b = after[between]
            share = (stamps_ns[between] - self.stamps_ns[a]) / step_ns[between]
            poses[between] = interpolate(self.world_T_body[a], self.world_T_body[b], share)
        return poses, exact | between


def interpolate(start: Poses, end: Poses, share: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) a share (n,) of the way from `start` to `end`.

    A share above 1 goes straight on past `end`, turning on.
    """
    Rotation = scipy.spatial.transform.Rotation
    turn = Rotation.from_matrix(start[:, :3, :3]).inv() * Rotation.from_matrix(end[:, :3, :3])
    poses = np.tile(np.eye(4), (len(share), 1, 1))
    part = Rotation.from_rotvec(turn.as_rotvec() * share[:, None])
    poses[:, :3, :3] = (Rotation.from_matrix(start[:, :3, :3]) * part).as_matrix()
    poses[:, :3, 3] = start[:, :3, 3] + share[:, None] * (end[:, :3, 3] - start[:, :3, 3])
    return poses


def days_between(start_ns: int, end_ns: int) -> int:
    """Calendar days (UTC) from one stamp to another."""
    day_ns = 86_400 * 10**9
    return int(end_ns) // day_ns - int(start_ns) // day_ns
