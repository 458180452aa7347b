"""Tells what is no map with z upwards: points in other axes, and single scans (METHODS 15)."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.local_ground import LocalGround

LEVEL_M = 30.0
"""Ground extends as far along both level axes; facades are seldom as high."""
LIFTS_M = (-0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Heights of a scan's sensor above the origin that are tried."""
NEAREST_M = 3.0
"""Points nearer to the sensor than this are of its vehicle."""
DIRECTION_DEG = 1.0
"""A direction is so wide and so high."""
BEHIND_SHARE = 0.2
BEHIND_M = 2.0
"""A point is hidden if it is farther than another in its direction by this share and this
distance."""


def upward_axis(points_m: NDArray[np.float64]) -> str | None:
    """The axis upwards from the ground of points (n, 3), such as "-z", if it is not z.

    It is None if no other axis shows the ground.
    """
    low_m, high_m = np.quantile(points_m, (0.02, 0.98), axis=0)
    extent_m = high_m - low_m
    for axis, sign in product(range(3), (1, -1)):
        level = [other for other in range(3) if other != axis]
        if (axis, sign) == (2, 1) or not (extent_m[level] > max(LEVEL_M, extent_m[axis])).all():
            continue
        turned_m = np.column_stack([points_m[:, level], sign * points_m[:, axis]])
        if LocalGround.of([turned_m]).has_ground:
            return ("-" if sign < 0 else "") + "xyz"[axis]
    return None


def hidden_share(points_m: NDArray[np.float64]) -> float:
    """The share of points (n, 3) that a sensor above the origin could not see behind others.

    It is small for a single scan: from wherever a map is seen, much of it is hidden.
    """
    shares = []
    for lift_m in LIFTS_M:
        beam_m = points_m - np.array([0.0, 0.0, lift_m])
        away_m = np.linalg.norm(beam_m, axis=1)
        beam_m, away_m = beam_m[away_m > NEAREST_M], away_m[away_m > NEAREST_M]
        if not len(away_m):
            return 1.0
        azimuth_deg = np.rad2deg(np.arctan2(beam_m[:, 1], beam_m[:, 0])) + 180
        height_deg = np.rad2deg(np.arcsin(beam_m[:, 2] / away_m)) + 90
        columns = int(360 / DIRECTION_DEG) + 1
        direction = (height_deg // DIRECTION_DEG).astype(np.int64) * columns
        direction += (azimuth_deg // DIRECTION_DEG).astype(np.int64)
        nearest_m = np.full(direction.max() + 1, np.inf)
        np.minimum.at(nearest_m, direction, away_m)
        is_hidden = away_m > nearest_m[direction] * (1 + BEHIND_SHARE) + BEHIND_M
        shares.append(float(is_hidden.mean()))
    return min(shares)
