"""Estimates how a scan is tilted, and whether it is upside down, from the plane of its ground.

Planes through random points are tried. The plane with most points on it is the ground, if it is
tilted and has clearly more points on it than the best level plane.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.mapping.ground import find_plane

LEVEL_DEG = 4.0
"""A ground that leans less than this is level."""
STEEPEST_DEG = 60.0
"""No ground leans more than this."""
PLANES = 400
"""How many random planes are tried."""
NEAR_M = 0.15
"""A point nearer to a plane than this lies on it."""
FROM_M = 2.0
TO_M = 25.0
"""Points between these distances from the sensor are used."""
APART_M = 0.4
"""One point is used per square with this side, since ground and walls near by are dense."""
LEAST_SHARE = 0.2
"""A tilted ground has at least this share of the points on it."""
LEAST_RATIO = 1.5
"""A tilted ground has at least this many times the points of the best level plane on it."""
OFF_GROUND_M = 0.5
BELOW_RATIO = 3.0
"""A scan is upside down if more than BELOW_RATIO times as many points lie OFF_GROUND_M below its
ground as lie OFF_GROUND_M above it."""


@dataclass(frozen=True)
class Lean:
    """How far a scan is tilted, and the pose that makes it upright."""

    tilt_deg: float
    """The angle between the normal of the ground and z, from 0 to 90; if the scan is upside down,
    between the normal and −z."""
    upside_down: bool
    upright_T_points: NDArray[np.float64]
    """(4, 4) turns the points by roll and pitch and raises them, so that the ground is at z = 0."""


def lean(points_m: NDArray[np.float64], upside_down: bool = False) -> Lean | None:
    """Estimate how a scan's points (n, 3) are tilted; None if level, or without a clear ground.

    If the scan is known to be upside down, level ground is accepted too.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    near_m = points_m[(range_m > FROM_M) & (range_m < TO_M)]
    squares = np.floor(near_m[:, :2] / APART_M).astype(np.int64)
    _, first_rows = np.unique(squares, axis=0, return_index=True)
    near_m = near_m[first_rows]

    level = _plane(near_m, LEVEL_DEG)
    steep = _plane(near_m, STEEPEST_DEG)
    ground = level if upside_down else None
    is_tilted = steep is not None and steep[2] < np.cos(np.deg2rad(LEVEL_DEG))
    fewest_points = max(LEAST_SHARE * len(near_m), LEAST_RATIO * _points_on(near_m, level))
    if is_tilted and _points_on(near_m, steep) > fewest_points:
        ground = steep
    if ground is None:
        return None

    heights_m = near_m @ ground[:3] - ground[3]
    below = (heights_m < -OFF_GROUND_M).sum()
    above = (heights_m > OFF_GROUND_M).sum()
    upside_down = upside_down or below > BELOW_RATIO * above
    tilt_deg = float(np.rad2deg(np.arccos(min(ground[2], 1.0))))
    # roll turns the upward normal until its y is 0, then pitch until its x is 0
    x, y, z, away_m = -ground if upside_down else ground
    roll_pitch_yaw = np.array([[np.arctan2(y, z), -np.arcsin(x), 0.0]])
    upright_T_points = pose(np.zeros((1, 3)), roll_pitch_yaw)[0]
    upright_T_points[2, 3] = -away_m
    return Lean(tilt_deg, upside_down, upright_T_points)


def _plane(points_m: NDArray[np.float64], steepest_deg: float) -> NDArray[np.float64] | None:
    """The plane (4,) that most points (n, 3) lie on: its unit normal, z up, and its distance."""
    coefficients = find_plane(points_m, NEAR_M, steepest_deg, PLANES, np.random.default_rng(0))
    if coefficients is None:
        return None
    a, b, c = coefficients  # of a x + b y + z = c
    return np.asarray(np.array([a, b, 1.0, c]) / np.sqrt(a * a + b * b + 1.0))


def _points_on(points_m: NDArray[np.float64], ground: NDArray[np.float64] | None) -> int:
    """How many points (n, 3) lie on a plane (4,); 0 without a plane."""
    if ground is None:
        return 0
    return int((np.abs(points_m @ ground[:3] - ground[3]) < NEAR_M).sum())
