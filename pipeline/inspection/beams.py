"""How many beams a spinning LiDAR has, and how high it sits: found from the points alone.

A beam keeps its elevation angle only when that is measured from where the sensor is. So the height from which the points fall
into the fewest cells of azimuth × elevation is the sensor's; and from there, in a slice of one degree of azimuth, where one
beam meets about one range, the beams stand apart and can be counted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VOTING_SLICES = 72
COUNTING_SLICES = 360
"""Of the round. Wide slices gather enough points of a beam to find the height; in narrow ones beams stand clear."""
SPARSE = 20_000
"""Fewer points than this are counted in slices three times as wide."""
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


def find_beams(points_m: NDArray[np.float64], ground_m: float, up: float = 1.0) -> Beams | None:
    """Beams of a cloud (n, 3) whose ground lies at z = `ground_m`; None where its points stand in no rings.

    The sensor is looked for on the z axis, 0.3 m to 4 m above the ground (`up` is −1.0 where z points down). Points on the
    ground do not vote for the height (seen from z = `ground_m` flat ground is one ring), but count among the beams. Beams
    without a return are not counted, so it may be some fewer than the sensor has.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    far = range_m > NEAR_M
    range_m, z_m = range_m[far], points_m[far, 2]
    turn = np.arctan2(points_m[far, 1], points_m[far, 0]) / (2 * np.pi) + 0.5
    voters = np.abs(z_m - ground_m) > 0.4
    if voters.sum() < 500:
        return None
    voting = _slices(turn[voters], VOTING_SLICES)

    def crowding(height_m: float) -> float:
        """Points per occupied cell, seen from that height."""
        return float(voters.sum()) / _occupied(voting, _elevation(z_m[voters] - height_m, range_m[voters]))

    coarse = ground_m + up * np.arange(0.3, 4.0, 0.1)
    scores = np.array([crowding(height) for height in coarse])
    best = coarse[scores.argmax()]
    if scores.max() < 1.5 * np.median(scores):
        return None
    fine = best + np.arange(-0.08, 0.09, 0.02)
    height_m = float(fine[np.argmax([crowding(height) for height in fine])])
    counting = _slices(turn, COUNTING_SLICES if len(turn) >= SPARSE else COUNTING_SLICES // 3)
    return Beams(_count(counting, _elevation(z_m - height_m, range_m)), height_m)


def _slices(turn: NDArray[np.float64], slices: int) -> NDArray[np.int64]:
    """Which slice of the round each share of it (n,) falls into."""
    return (turn * slices).astype(np.int64).clip(0, slices - 1)


def _elevation(rise_m: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees above the horizon."""
    return np.degrees(np.arctan2(rise_m, range_m))


def _occupied(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    rows = int(180 / CELL_DEG)
    cells = np.zeros(VOTING_SLICES * rows, bool)
    cells[slices * rows + ((elevation_deg + 90) / CELL_DEG).astype(np.int64).clip(0, rows - 1)] = True
    return int(np.count_nonzero(cells))


def _count(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    """Clusters of elevation in the 60th part of the slices that shows the most: most slices look into the sky with some beams."""
    order = np.lexsort((elevation_deg, slices))
    slices, elevation_deg = slices[order], elevation_deg[order]
    first = np.ones(len(slices), bool)
    first[1:] = (np.diff(slices) != 0) | (np.diff(elevation_deg) > GAP_DEG)
    counts = np.sort(np.bincount(slices[first], minlength=VOTING_SLICES))
    found = int(counts[-max(1, round(np.count_nonzero(counts) / 60))])
    usual = min(USUAL, key=lambda count: abs(count - found))
    return usual if abs(usual - found) <= 0.07 * usual else found
