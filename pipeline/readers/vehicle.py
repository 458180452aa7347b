"""Checks that the poses of a log are those of a vehicle, and cuts odometry where it jumps.

A vehicle is upright, drives forward or backward, and does not jump. `describe_faults` says, in
lines for the user, what speaks against that in a trajectory: mostly wrong axes, units or clocks.
`split_at_jumps` makes a gap in an odometry at each jump, since odometry was set back there.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import (
    Poses,
    Stamps,
    Trajectory,
    distance_and_turn,
    step_lengths_m,
    travelled_m,
)

TILTED_DEG = 45.0
TILTED_SHARE = 0.1
"""A body tilted by more than TILTED_DEG in more than this share of its poses is no vehicle."""
STEP_M = 2.0
"""Distance between the poses that give the direction of driving; shorter steps are mostly noise."""
MIN_STEPS = 5
"""With fewer steps of STEP_M, the direction of driving is not checked."""
ALONG_SHARE = 0.8
"""A step is along an axis if more than this share of its length is."""
MIN_AGREEMENT = 0.3
"""With a smaller agreement of the directions of driving in the body's frame, its heading is wrong.

The agreement is 1 if all directions are one direction or its opposite, 0 if they are spread all
round.
"""
STEEP = 0.5
"""A road climbs less than this, in metres of height a metre of path."""
NEIGHBOURHOOD_S = 1.0
MAX_NEIGHBOURS = 200
"""A step is compared with its neighbours, the steps of NEIGHBOURHOOD_S before and after it.

They are at most MAX_NEIGHBOURS on either side, since some topics repeat each pose many times.
"""
FASTEST_M_S = 100.0
"""No vehicle is faster."""
JUMP_M = 0.5
GAIN_M_S2 = 5.0
JUMP_DEG = 30.0
GAIN_DEG_S = 360.0
"""A step of dt seconds may exceed the fastest of its neighbours, over dt, by JUMP_M + GAIN_M_S2 dt²
in length and by JUMP_DEG + GAIN_DEG_S dt in turn; beyond that it is a jump."""


def describe_faults(name: str, ground_truth: Trajectory) -> tuple[str, ...]:
    """Lines on what no vehicle does in a trajectory; empty if all is well.

    The world is z-up, the body x forward, y left, z up. The lines call the trajectory `name`.
    """
    is_finite = np.isfinite(ground_truth.world_T_body).all(axis=(1, 2))
    poses = ground_truth.world_T_body[is_finite]
    if not len(poses):
        return ()
    speed_m_s = _median_speed_m_s(ground_truth)
    if speed_m_s > FASTEST_M_S:
        return (
            f"{name}: the body drives at {speed_m_s:,.0f} m/s most of the way: are its positions "
            "in metres, its stamps in order?",
        )
    lines = []
    tilt_deg = np.rad2deg(np.arccos(poses[:, 2, 2].clip(-1, 1)))
    if (tilt_deg > TILTED_DEG).mean() > TILTED_SHARE:
        lines.append(
            f"{name}: the body is tilted by up to {np.percentile(tilt_deg, 95):.0f}°, where a "
            "vehicle stands upright: is the quaternion written w first (write x y z w), or are its "
            "axes a camera's (poses_frame: camera)?"
        )
    lines += _direction_warnings(name, poses)
    rows = find_jumps(ground_truth)
    if len(rows):
        why = "are two drives in one file, was odometry set back, or a map corrected?"
        lines.append(f"{name}: {_jumps_text(ground_truth, rows)}: no vehicle drives so; {why}")
    return tuple(lines)


def split_at_jumps(name: str, odometry: Trajectory) -> tuple[Trajectory, tuple[str, ...]]:
    """The odometry with a gap, a row of NaN, at each jump, and a note on the jumps for the user."""
    rows = find_jumps(odometry)
    if not len(rows):
        return odometry, ()
    gaps_ns = odometry.stamps_ns[rows - 1] + 1
    stamps_ns = np.insert(odometry.stamps_ns, rows, gaps_ns)
    world_T_body = np.insert(odometry.world_T_body, rows, np.nan, axis=0)
    # no gap fits between two poses that are only 1 ns apart
    fits = np.diff(stamps_ns, append=stamps_ns[-1] + 1) > 0
    with_gaps = replace(odometry, stamps_ns=stamps_ns[fits], world_T_body=world_T_body[fits])
    return with_gaps, (f"{name}: {_jumps_text(odometry, rows)}: the odometry starts again there",)


def find_jumps(trajectory: Trajectory) -> NDArray[np.int64]:
    """The rows (k,) at the end of jumps: steps far longer or wider than those before and after."""
    finite_rows = np.flatnonzero(np.isfinite(trajectory.world_T_body).all(axis=(1, 2)))
    if len(finite_rows) < 2:
        return np.empty(0, np.int64)
    # 1. Compute the length, turn and time of each step between two known poses.
    poses = trajectory.world_T_body[finite_rows]
    seconds = np.diff(trajectory.stamps_ns[finite_rows]) / 1e9
    step_m, turn_deg = distance_and_turn(poses[:-1], poses[1:])
    is_step = (np.diff(finite_rows) == 1) & (seconds <= trajectory.max_gap_s)
    # 2. Compute by how much it exceeds the fastest of its neighbours.
    typical_count = NEIGHBOURHOOD_S / np.median(seconds)
    count = int(np.clip(np.rint(typical_count), 1, MAX_NEIGHBOURS))
    excess_m = step_m - seconds * _fastest_neighbour(step_m / seconds, is_step, count)
    excess_deg = turn_deg - seconds * _fastest_neighbour(turn_deg / seconds, is_step, count)
    # 3. Find the jumps in position or heading.
    is_too_fast = (step_m > JUMP_M) & (step_m > FASTEST_M_S * seconds)
    is_far = (excess_m > JUMP_M + GAIN_M_S2 * seconds**2) | is_too_fast
    is_wide = excess_deg > JUMP_DEG + GAIN_DEG_S * seconds
    return np.asarray(finite_rows[1:][is_step & (is_far | is_wide)])


def find_breaks(odometry: Trajectory) -> Stamps:
    """The stamps (k,) of the first known pose after each gap in the odometry.

    A gap is rows of NaN, or neighbours further apart in time than max_gap_s.
    """
    finite_rows = np.flatnonzero(np.isfinite(odometry.world_T_body).all(axis=(1, 2)))
    step_s = np.diff(odometry.stamps_ns[finite_rows]) / 1e9
    is_break = (np.diff(finite_rows) > 1) | (step_s > odometry.max_gap_s)
    return np.asarray(odometry.stamps_ns[finite_rows[1:][is_break]])


def _direction_warnings(name: str, poses: Poses) -> list[str]:
    """One line if the body of the poses (n, 4, 4) does not drive along its x axis, else none."""
    step_m, body_step_m = _path_steps(poses)
    if len(step_m) < MIN_STEPS:
        return []
    # typical shares of a step that are along the body's y and z axes and the world's z axis
    length_m = np.linalg.norm(step_m, axis=1)
    shares = np.abs(np.column_stack([body_step_m[:, 1:], step_m[:, 2]])) / length_m[:, None]
    y_share, z_share, climb = np.median(shares, axis=0)
    # by the doubled angle, which is the same forward and backward
    agreement = abs(np.exp(2j * np.arctan2(body_step_m[:, 1], body_step_m[:, 0])).mean())
    if z_share > ALONG_SHARE:
        return [
            f"{name}: the body drives along its own z axis: are its axes a camera's, x right, "
            "y down, z forward? Set poses_frame: camera, or take the topic of the body's poses"
        ]
    if y_share > ALONG_SHARE:
        return [
            f"{name}: the body drives sideways, along its own y axis: is its heading a quarter "
            "turn off? Turn its poses, or take the topic of the body's"
        ]
    if agreement < MIN_AGREEMENT:
        return [
            f"{name}: the body's heading does not follow its way: are its rotations missing, "
            "or those of the inverse? Each pose must take points of the body into the world"
        ]
    if climb > STEEP:
        slope_deg = np.rad2deg(np.arcsin(climb))
        return [
            f"{name}: the path climbs or falls by {slope_deg:.0f}° most of the way: is z up in "
            "its world? Turn the poses so that it is, or set poses_frame: camera"
        ]
    return []


def _median_speed_m_s(ground_truth: Trajectory) -> float:
    """The median speed over the steps in which the body moves; 0 if it never does."""
    finite_rows = np.flatnonzero(np.isfinite(ground_truth.world_T_body).all(axis=(1, 2)))
    step_m = step_lengths_m(ground_truth.world_T_body[finite_rows, :3, 3])
    is_moving = step_m > 0
    if not is_moving.any():
        return 0.0
    step_ns = np.diff(ground_truth.stamps_ns[finite_rows])
    speeds_m_s = step_m[is_moving] / step_ns[is_moving] * 1e9
    return float(np.median(speeds_m_s))


def _fastest_neighbour(
    rates: NDArray[np.float64], is_step: NDArray[np.bool_], count: int
) -> NDArray[np.float64]:
    """For each step the largest of the rates (n,) of the `count` steps before and after it."""
    padding = np.full(count, -1.0)  # less than any rate
    padded_rates = np.concatenate([padding, np.where(is_step, rates, -1.0), padding])
    windows = np.lib.stride_tricks.sliding_window_view(padded_rates, count)
    window_maxima = windows.max(axis=1)
    maxima_before = window_maxima[: len(rates)]  # window i ends before step i
    maxima_after = window_maxima[-len(rates) :]
    maxima = np.maximum(maxima_before, maxima_after)
    return np.where(maxima < 0, np.inf, maxima)


def _path_steps(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps (k, 3) of about STEP_M or more along a path, in its world and in the body's frame."""
    path_m = travelled_m(poses[:, :3, 3])
    # the first pose of each STEP_M of path
    _, rows = np.unique(path_m // STEP_M, return_index=True)
    step_m = np.diff(poses[rows, :3, 3], axis=0)
    body_step_m = np.asarray(np.einsum("nji,nj->ni", poses[rows[:-1], :3, :3], step_m))
    is_long = np.linalg.norm(step_m, axis=1) > STEP_M / 2
    return step_m[is_long], body_step_m[is_long]


def _jumps_text(trajectory: Trajectory, rows: NDArray[np.int64]) -> str:
    """How often a trajectory jumps, and how far at the first of the `rows` (k,) that end a jump."""
    first_row = rows[0]
    away_m, turn_deg = distance_and_turn(
        trajectory.world_T_body[first_row - 1], trajectory.world_T_body[first_row]
    )
    seconds = (trajectory.stamps_ns[first_row] - trajectory.stamps_ns[first_row - 1]) / 1e9
    times = "once" if len(rows) == 1 else f"{len(rows):,} times"
    first_s = trajectory.stamps_ns[first_row] / 1e9
    return (
        f"jumps {times}, first at {first_s:.3f} s by {away_m:.3g} m and {turn_deg:.0f}° in "
        f"{seconds:.3g} s"
    )
