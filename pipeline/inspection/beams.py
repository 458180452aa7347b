"""How many beams a spinning LiDAR has, and how high it sits: found from the points alone.

A beam keeps its elevation angle only when that is measured from where the sensor is. So the height from which the points fall
into the fewest cells of azimuth × elevation is the sensor's; and from there, in a slice of one degree of azimuth, where one
beam meets about one range, the beams stand apart and can be counted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SLICES = 360
CELL_DEG = 0.05
GAP_DEG = 0.2
"""Neighbouring beams stand further apart than this: 0.33° on an HDL-64, 0.35° on 128 beams over 45°."""
NEAR_M = 3.0
"""Nearer points say little: the laser's own place in the housing is no longer negligible."""
USUAL = (1, 4, 8, 16, 32, 40, 64, 80, 128)
"""Beam counts that sensors have; a count within 7 % of one is that one."""


@dataclass(frozen=True)
class Beams:
    """What the points say of the sensor."""

    count: int
    height_m: float
    """z of the sensor, in the points' frame."""


def find_beams(points_m: NDArray[np.float64], ground_m: float) -> Beams | None:
    """Beams of a cloud (n, 3) whose ground lies at z = `ground_m`; None where its points stand in no rings.

    The sensor is looked for on the z axis, within 4 m of the ground. Points on the ground do not vote for the height (seen
    from z = `ground_m` flat ground is one ring), but count among the beams.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    far = range_m > NEAR_M
    range_m, z_m = range_m[far], points_m[far, 2]
    slices = ((np.arctan2(points_m[far, 1], points_m[far, 0]) / (2 * np.pi) + 0.5) * SLICES).astype(np.int64).clip(0, SLICES - 1)
    voters = np.abs(z_m - ground_m) > 0.4
    if voters.sum() < 500:
        return None

    def crowding(height_m: float) -> float:
        """Points per occupied cell, seen from that height."""
        return float(voters.sum()) / _occupied(slices[voters], _elevation(z_m[voters] - height_m, range_m[voters]))

    coarse = ground_m + np.arange(-4.0, 4.05, 0.1)
    scores = np.array([crowding(height) for height in coarse])
    best = coarse[scores.argmax()]
    if scores.max() < 1.3 * np.median(scores):
        return None
    fine = best + np.arange(-0.08, 0.09, 0.02)
    height_m = float(fine[np.argmax([crowding(height) for height in fine])])
    return Beams(_count(slices, _elevation(z_m - height_m, range_m)), height_m)


def _elevation(rise_m: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees above the horizon."""
    return np.degrees(np.arctan2(rise_m, range_m))


def _occupied(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    rows = int(180 / CELL_DEG)
    cells = np.zeros(SLICES * rows, bool)
    cells[slices * rows + ((elevation_deg + 90) / CELL_DEG).astype(np.int64).clip(0, rows - 1)] = True
    return int(np.count_nonzero(cells))


def _count(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    """Clusters of elevation in the slices that show the most: most slices look into the sky with some beams."""
    order = np.lexsort((elevation_deg, slices))
    slices, elevation_deg = slices[order], elevation_deg[order]
    first = np.ones(len(slices), bool)
    first[1:] = (np.diff(slices) != 0) | (np.diff(elevation_deg) > GAP_DEG)
    counts = np.sort(np.bincount(slices[first], minlength=SLICES))
    found = int(counts[-6])
    usual = min(USUAL, key=lambda count: abs(count - found))
    return usual if abs(usual - found) <= 0.07 * usual else found
