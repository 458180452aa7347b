"""Estimates how a scan is tilted, from the plane that most of its points lie on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.mapping.ground import plane

LEVEL_DEG = 4.0
"""A ground that leans less than this is level."""
STEEPEST_DEG = 60.0
"""No ground leans more than this."""
PLANES = 400
"""Planes that are tried."""
NEAR_M = 0.15
"""A point nearer to a plane than this lies on it."""
FROM_M = 2.0
TO_M = 25.0
APART_M = 0.4
"""Points at these distances are looked at, one in a square of a side, since near ground and walls
are dense."""
OVER_M = 0.5
MORE = 3.0
"""Points farther than OVER_M from the ground stand; where MORE times as many lie below it as above,
the scan is upside down."""
LEAST = 0.2
CLEARLY = 1.5
"""A ground holds LEAST of the points, and CLEARLY times what the best level plane holds."""


@dataclass(frozen=True)
class Lean:
    """How far a scan is tilted, and the pose that makes it upright."""

    tilt_deg: float
    """Between the normal of the ground and z, 0 to 90; of a scan that is upside down, between it
    and −z."""
    upside_down: bool
    upright_T_points: NDArray[np.float64]
    """(4, 4) turns by roll and pitch, and raises, so that the ground is at z = 0."""


def lean(points_m: NDArray[np.float64], upside_down: bool = False) -> Lean | None:
    """Estimate how a scan (n, 3) is tilted; None if it is level, or has no clear ground.

    A scan that is known to be upside down is never level.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    near_m = points_m[(range_m > FROM_M) & (range_m < TO_M)]
    near_m = near_m[
        np.unique(np.floor(near_m[:, :2] / APART_M).astype(np.int64), axis=0, return_index=True)[1]
    ]
    level = _plane(near_m, LEVEL_DEG)
    steep = _plane(near_m, STEEPEST_DEG)
    ground = level if upside_down else None
    leaning = steep is not None and steep[2] < np.cos(np.deg2rad(LEVEL_DEG))
    if leaning and _points_on(near_m, steep) > max(
        LEAST * len(near_m), CLEARLY * _points_on(near_m, level)
    ):
        ground = steep
    if ground is None:
        return None
    heights_m = near_m @ ground[:3] - ground[3]
    upside_down = upside_down or (heights_m < -OVER_M).sum() > MORE * (heights_m > OVER_M).sum()
    tilt_deg = float(np.rad2deg(np.arccos(min(ground[2], 1.0))))
    x, y, z, away_m = -ground if upside_down else ground
    turned = pose(np.zeros((1, 3)), np.array([[np.arctan2(y, z), -np.arcsin(x), 0.0]]))[0]
    turned[2, 3] = -away_m
    return Lean(tilt_deg, upside_down, turned)


def _plane(points_m: NDArray[np.float64], steepest_deg: float) -> NDArray[np.float64] | None:
    """The plane that most points lie on: its unit normal, z up, and the distance along it (4,)."""
    coefficients = plane(points_m, NEAR_M, steepest_deg, PLANES, np.random.default_rng(0))
    if coefficients is None:
        return None
    a, b, c = coefficients
    return np.asarray(np.array([a, b, 1.0, c]) / np.sqrt(a * a + b * b + 1.0))


def _points_on(points_m: NDArray[np.float64], ground: NDArray[np.float64] | None) -> int:
    """How many points lie on a plane; 0 without a plane."""
    return 0 if ground is None else int((np.abs(points_m @ ground[:3] - ground[3]) < NEAR_M).sum())
