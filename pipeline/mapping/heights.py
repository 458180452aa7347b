"""Heights of points above the ground, on slopes too: a hillside is no wall (METHODS 9.2).

In: the points of a scan. Out: the height of each point above the ground. The steps follow
Himmelsbach et al., IV 2010:

1. Divide the plane around the sensor into SECTORS directions, and each direction into pieces.
2. Take the lowest point of each piece as a candidate for the ground.
3. In each direction, follow the ground outwards. A piece is ground if it is no steeper than SLOPE
   allows; otherwise the ground continues at the height of the last piece that was ground.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

SECTORS = 72
"""Directions around the sensor in which the ground is followed."""
STEP_M = 1.0
"""Length of a piece along its direction."""
SLOPE = 0.15
"""Steepest climb or fall from one piece of ground to the next."""
ROUGH_M = 0.3
"""On top of SLOPE, a piece of ground may be this much higher or lower."""
LEAP_M = 1.0
"""A piece of ground is at most this much higher or lower, however far away the last piece is."""
FAR_M = 200.0
"""The ground is followed up to this range; points beyond belong to the last piece."""


def heights_m(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The height (n,) in metres of points (n, 3) above the ground, which is at z = 0 at the sensor.

    It is NaN for a point that is not finite.
    """
    heights: NDArray[np.float64] = _heights(np.asarray(points_m, np.float64))
    return heights


@njit(cache=True, nogil=True, error_model="numpy")
def _heights(points):  # type: ignore[no-untyped-def]
    """The heights (n,) of points (n, 3)."""
    # The lowest point of each piece.
    steps = int(FAR_M / STEP_M)
    lowest = np.full((SECTORS, steps), np.inf)
    for i in range(len(points)):
        if np.isfinite(points[i].sum()):
            sector, step = _piece(points[i, 0], points[i, 1])
            lowest[sector, step] = min(lowest[sector, step], points[i, 2])
    # The ground, followed outwards from z = 0.
    ground = np.zeros((SECTORS, steps))
    for sector in range(SECTORS):
        last_step = 0  # the last piece that was ground
        height = 0.0
        for step in range(steps):
            largest_rise = min(ROUGH_M + SLOPE * STEP_M * (step - last_step), LEAP_M)
            if abs(lowest[sector, step] - height) <= largest_rise:
                last_step = step
                height = lowest[sector, step]
            ground[sector, step] = height
    # The points above it.
    heights = np.full(len(points), np.nan)
    for i in range(len(points)):
        if np.isfinite(points[i].sum()):
            sector, step = _piece(points[i, 0], points[i, 1])
            heights[i] = points[i, 2] - ground[sector, step]
    return heights


@njit(cache=True, nogil=True, error_model="numpy")
def _piece(x, y):  # type: ignore[no-untyped-def]
    """The sector of a point, and the piece in it."""
    sector = int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS) % SECTORS
    return sector, int(min(np.hypot(x, y), FAR_M - STEP_M) / STEP_M)
