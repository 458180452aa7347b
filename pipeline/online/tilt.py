"""How a scan leans: by the plane that most of its points lie on, where that is clearly another than
a level one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import pose
from pipeline.mapping.ground import plane

LEVEL_DEG = 4.0
"""A ground that leans less is level."""
STEEPEST_DEG = 60.0
"""No ground leans more."""
PLANES = 400
"""That are tried."""
NEAR_M = 0.15
"""A point so near to a plane lies on it."""
FROM_M = 2.0
TO_M = 25.0
APART_M = 0.4
"""Points at these distances are looked at, one in a square of a side, since near ground and walls
are dense."""
OVER_M = 0.5
MORE = 3.0
"""What stands is so far off the ground; where so many times more is below than above, the scan is
upside down."""
LEAST = 0.2
CLEARLY = 1.5
"""A ground holds this share of them, and so many times what the best level plane holds."""


@dataclass(frozen=True)
class Lean:
    """How a scan leans."""

    tilt_deg: float
    """Between the normal of the ground and z, 0 to 90; of a scan that is upside down, between it
    and −z."""
    upside_down: bool
    upright_T_points: NDArray[np.float64]
    """(4, 4) turns by roll and pitch, and raises, so that the ground is at z = 0."""


def lean(points_m: NDArray[np.float64], upside_down: bool = False) -> Lean | None:
    """How a scan (n, 3) leans; None of one that is level, or has no clear ground.

    One known as upside down leans in any case.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    near_m = points_m[(range_m > FROM_M) & (range_m < TO_M)]
    near_m = near_m[
        np.unique(np.floor(near_m[:, :2] / APART_M).astype(np.int64), axis=0, return_index=True)[1]
    ]
    level = _plane(near_m, LEVEL_DEG)
    steep = _plane(near_m, STEEPEST_DEG)
    found = level if upside_down else None
    leaning = steep is not None and steep[2] < np.cos(np.deg2rad(LEVEL_DEG))
    if leaning and _held(near_m, steep) > max(LEAST * len(near_m), CLEARLY * _held(near_m, level)):
        found = steep
    if found is None:
        return None
    heights_m = near_m @ found[:3] - found[3]
    upside_down = upside_down or (heights_m < -OVER_M).sum() > MORE * (heights_m > OVER_M).sum()
    tilt_deg = float(np.rad2deg(np.arccos(min(found[2], 1.0))))
    x, y, z, away_m = -found if upside_down else found
    turned = pose(np.zeros((1, 3)), np.array([[np.arctan2(y, z), -np.arcsin(x), 0.0]]))[0]
    turned[2, 3] = -away_m
    return Lean(tilt_deg, upside_down, turned)


def _plane(points_m: NDArray[np.float64], steepest_deg: float) -> NDArray[np.float64] | None:
    """The unit normal, z up, and the distance along it (4,) of the plane that most points lie
    on."""
    found = plane(points_m, NEAR_M, steepest_deg, PLANES, np.random.default_rng(0))
    if found is None:
        return None
    a, b, c = found
    return np.asarray(np.array([a, b, 1.0, c]) / np.sqrt(a * a + b * b + 1.0))


def _held(points_m: NDArray[np.float64], found: NDArray[np.float64] | None) -> int:
    """How many points lie on a plane; 0 of none."""
    return 0 if found is None else int((np.abs(points_m @ found[:3] - found[3]) < NEAR_M).sum())
