"""Whether poses are a vehicle's: upright, along the way that it looks, and without steps that
nothing can drive."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import ROUNDED_NS, Poses, Stamps, Trajectory, apart

TILTED_DEG = 45.0
TILTED_SHARE = 0.1
"""A body that is tilted further in more than this share of its poses is not one that stands on the
ground."""
STEP_M = 2.0
"""The way between poses that tell where a body drives: shorter steps are mostly noise."""
FEWEST = 5
"""Such steps tell nothing if they are fewer."""
ALONG = 0.8
"""Of a step of one metre: so much of it along an axis is along that axis."""
ASTRAY = 0.3
"""Directions of driving, seen from the body, that agree less than this: 1 where all are one or its
opposite, 0 where all are."""
STEEP = 0.5
"""A road climbs less than this, in metres a metre."""
AROUND_S = 1.0
MOST = 200
"""A step is held against those of a second before and after it, of which there may be many: some
topics repeat a pose."""
FASTEST_M_S = 100.0
JUMP_M = 0.5
GAIN_M_S2 = 5.0
"""A step of dt seconds is a jump if it is longer, by JUMP_M + GAIN_M_S2 dt² and more, than the
fastest of those makes it."""
JUMP_DEG = 30.0
GAIN_DEG_S = 360.0
"""It is one too if it turns further than the widest of those makes it, by JUMP_DEG + GAIN_DEG_S dt
and more."""


def jumps(trajectory: Trajectory) -> NDArray[np.int64]:
    """The rows (k,) to which steps lead that no vehicle makes: far longer or wider than those
    before and after."""
    known = np.flatnonzero(np.isfinite(trajectory.world_T_body).all(axis=(1, 2)))
    if len(known) < 2:
        return np.empty(0, np.int64)
    poses = trajectory.world_T_body[known]
    seconds = np.diff(trajectory.stamps_ns[known]) / 1e9
    step_m, turn_deg = apart(poses[:-1], poses[1:])
    together = (np.diff(known) == 1) & (seconds <= trajectory.max_gap_s)
    around = int(np.clip(np.rint(AROUND_S / np.median(seconds)), 1, MOST))
    longer_m = step_m - seconds * _neighbours(step_m / seconds, together, around)
    wider_deg = turn_deg - seconds * _neighbours(turn_deg / seconds, together, around)
    far = (longer_m > JUMP_M + GAIN_M_S2 * seconds**2) | (
        (step_m > JUMP_M) & (step_m > FASTEST_M_S * seconds)
    )
    wide = wider_deg > JUMP_DEG + GAIN_DEG_S * seconds
    return np.asarray(known[1:][together & (far | wide)])


def parted(name: str, odometry: Trajectory) -> tuple[Trajectory, tuple[str, ...]]:
    """Odometry with a gap at each jump, as where a robot's odometry was set back, and a note that
    says so."""
    rows = jumps(odometry)
    if not len(rows):
        return odometry, ()
    gaps_ns = odometry.stamps_ns[rows - 1] + 1
    stamps_ns = np.insert(odometry.stamps_ns, rows, gaps_ns)
    world_T_body = np.insert(odometry.world_T_body, rows, np.nan, axis=0)
    fresh = np.diff(stamps_ns, append=stamps_ns[-1] + 1) > 0
    mended = replace(odometry, stamps_ns=stamps_ns[fresh], world_T_body=world_T_body[fresh])
    return mended, (f"{name}: {_jumped(odometry, rows)}: the odometry starts anew there",)


def along(odometry: Trajectory, stamps_ns: Stamps, anew_ns: Stamps) -> Poses:
    """Odometry (n, 4, 4) at increasing stamps (n,); NaN where there is none, and at the first after
    it starts `anew_ns` (k,)."""
    odom_T_body = odometry.at(stamps_ns)[0]
    first = np.searchsorted(stamps_ns, anew_ns - ROUNDED_NS)
    odom_T_body[first[first < len(stamps_ns)]] = np.nan
    return odom_T_body


def breaks_ns(odometry: Trajectory) -> Stamps:
    """The stamps (k,) of the first known poses behind gaps: rows of NaN, or neighbours further
    apart than max_gap_s."""
    known = np.flatnonzero(np.isfinite(odometry.world_T_body).all(axis=(1, 2)))
    apart_s = np.diff(odometry.stamps_ns[known]) / 1e9
    broken = (np.diff(known) > 1) | (apart_s > odometry.max_gap_s)
    return np.asarray(odometry.stamps_ns[known[1:][broken]])


def doubts(name: str, truth: Trajectory) -> tuple[str, ...]:
    """Lines on what no vehicle does, for poses in a z-up world of a body x forward, y left, z up;
    none where all is well."""
    known = np.isfinite(truth.world_T_body).all(axis=(1, 2))
    poses = truth.world_T_body[known]
    if not len(poses):
        return ()
    lines = []
    usual_m_s = _usual_m_s(truth)
    if usual_m_s > FASTEST_M_S:
        return (
            f"{name}: the body drives at {usual_m_s:,.0f} m/s most of the way: are its positions "
            "in metres, its stamps in order?",
        )
    tilt_deg = np.rad2deg(np.arccos(poses[:, 2, 2].clip(-1, 1)))
    if (tilt_deg > TILTED_DEG).mean() > TILTED_SHARE:
        lines.append(
            f"{name}: the body is tilted by up to {np.percentile(tilt_deg, 95):.0f}°, where a "
            "vehicle stands upright: is the quaternion written w first, or are its axes a "
            "camera's?"
        )
    step_m, ahead = _driven(poses)
    length_m = np.linalg.norm(step_m, axis=1)
    if len(step_m) >= FEWEST:
        across, up, climb = np.median(
            np.abs(np.column_stack([ahead[:, 1:], step_m[:, 2]])) / length_m[:, None], axis=0
        )
        if up > ALONG:
            lines.append(
                f"{name}: the body drives along its own z axis: are its axes a camera's, x right, "
                "y down, z forward?"
            )
        elif across > ALONG:
            lines.append(
                f"{name}: the body drives sideways, along its own y axis: is its heading a quarter "
                "turn off?"
            )
        elif abs(np.exp(2j * np.arctan2(ahead[:, 1], ahead[:, 0])).mean()) < ASTRAY:
            lines.append(
                f"{name}: the body's heading does not follow its way: are its rotations missing, "
                "or those of the inverse?"
            )
        elif climb > STEEP:
            slope_deg = np.rad2deg(np.arcsin(climb))
            lines.append(
                f"{name}: the path climbs or falls by {slope_deg:.0f}° most of the way: is z up in "
                "its world?"
            )
    rows = jumps(truth)
    if len(rows):
        why = "are two drives in one file, was odometry set back, or a map corrected?"
        lines.append(f"{name}: {_jumped(truth, rows)}: no vehicle drives so; {why}")
    return tuple(lines)


def _usual_m_s(truth: Trajectory) -> float:
    """The median speed of the steps of a body that moves; 0 of one that never does."""
    known = np.flatnonzero(np.isfinite(truth.world_T_body).all(axis=(1, 2)))
    step_m = np.linalg.norm(np.diff(truth.world_T_body[known, :3, 3], axis=0), axis=1)
    moving = step_m > 0
    speeds = step_m[moving] / np.diff(truth.stamps_ns[known])[moving] * 1e9
    return float(np.median(speeds)) if moving.any() else 0.0


def _neighbours(
    rates: NDArray[np.float64], known: NDArray[np.bool_], around: int
) -> NDArray[np.float64]:
    """The largest rate (n,) of so many steps before and after each step; infinite where none of
    them is `known`."""
    unknown = np.full(around, -1.0)
    wide = np.concatenate([unknown, np.where(known, rates, -1.0), unknown])
    largest = np.lib.stride_tricks.sliding_window_view(wide, around).max(axis=1)
    larger = np.maximum(largest[: len(rates)], largest[-len(rates) :])
    return np.where(larger < 0, np.inf, larger)


def _driven(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps (k, 3) of about STEP_M or more of a path, in its world, and the same in the frame of
    the body where each begins."""
    way_m = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1))]
    )
    rows = np.unique(way_m // STEP_M, return_index=True)[1]
    step_m = np.diff(poses[rows, :3, 3], axis=0)
    ahead = np.asarray(np.einsum("nji,nj->ni", poses[rows[:-1], :3, :3], step_m))
    far = np.linalg.norm(step_m, axis=1) > STEP_M / 2
    return step_m[far], ahead[far]


def _jumped(trajectory: Trajectory, rows: NDArray[np.int64]) -> str:
    """How often and how far a trajectory jumps."""
    first = rows[0]
    away_m, turn_deg = apart(trajectory.world_T_body[[first - 1]], trajectory.world_T_body[[first]])
    seconds = (trajectory.stamps_ns[first] - trajectory.stamps_ns[first - 1]) / 1e9
    times = "once" if len(rows) == 1 else f"{len(rows):,} times"
    at = f"{trajectory.stamps_ns[first] / 1e9:.3f} s"
    return (
        f"jumps {times}, first at {at} by {away_m[0]:.3g} m and {turn_deg[0]:.0f}° in "
        f"{seconds:.3g} s"
    )
