"""Ground: how high points stand above it, on slopes too (METHODS 9.2).

A hillside is no wall. So the ground is followed outwards from the sensor in each direction, as far
as it climbs and falls no more steeply than ground does (as Himmelsbach et al., IV 2010).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

SECTORS = 72
"""Directions around the sensor in which the ground is followed."""
STEP_M = 1.0
"""The lowest point of each such piece of a direction may be ground."""
SLOPE = 0.15
"""Steepest climb or fall from one piece of ground to the next."""
ROUGH_M = 0.3
"""On top of SLOPE, a piece may be this much higher or lower."""
LEAP_M = 1.0
"""Ground is not followed across a higher step, however far off it is seen again."""
FAR_M = 200.0
"""Ground is not followed beyond: what stands there stands on the last that was."""


def heights_m(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The height (n,) of points (n, 3) above the ground, which is at z = 0 around the sensor.

    NaN for a point that is not finite.
    """
    heights: NDArray[np.float64] = _heights(np.asarray(points_m, np.float64))
    return heights


@njit(cache=True, nogil=True, error_model="numpy")
def _heights(points):  # type: ignore[no-untyped-def]
    steps = int(FAR_M / STEP_M)
    lowest = np.full((SECTORS, steps), np.inf)
    for i in range(len(points)):
        if np.isfinite(points[i].sum()):
            sector, step = _piece(points[i, 0], points[i, 1])
            lowest[sector, step] = min(lowest[sector, step], points[i, 2])
    ground = np.zeros((SECTORS, steps))
    for sector in range(SECTORS):
        seen_at = 0
        height = 0.0
        for step in range(steps):
            largest_step = min(ROUGH_M + SLOPE * STEP_M * (step - seen_at), LEAP_M)
            if abs(lowest[sector, step] - height) <= largest_step:
                seen_at = step
                height = lowest[sector, step]
            ground[sector, step] = height
    heights = np.full(len(points), np.nan)
    for i in range(len(points)):
        if np.isfinite(points[i].sum()):
            sector, step = _piece(points[i, 0], points[i, 1])
            heights[i] = points[i, 2] - ground[sector, step]
    return heights


@njit(cache=True, nogil=True, error_model="numpy")
def _piece(x, y):  # type: ignore[no-untyped-def]
    sector = int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS) % SECTORS
    return sector, int(min(np.hypot(x, y), FAR_M - STEP_M) / STEP_M)
