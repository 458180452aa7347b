"""Estimates the number of beams of a spinning LiDAR and its height from the points alone.

A beam has a constant elevation angle only if the angle is measured from the sensor. So the height
from which the points fall into the fewest cells of azimuth × elevation is that of the sensor. Seen
from there, the beams in a slice of one degree of azimuth are separate clusters of elevation and can
be counted.
"""

import numpy as np
from numpy.typing import NDArray

VOTING_SLICES = 72
COUNTING_SLICES = 360
"""Slices of 360°.

Wide ones hold enough points of each beam to find the height, in narrow ones the beams are separate.
"""
SPARSE = 20_000
"""Clouds with fewer points are counted in slices three times as wide."""
CELL_DEG = 0.05
GAP_DEG = 0.2
"""Neighbouring beams are further apart than this: 0.33° on an HDL-64, 0.35° on 128 beams over
45°."""
NEAR_M = 3.0
"""Nearer points are not used: there the offset of a laser inside the housing is not negligible."""
USUAL = (1, 4, 8, 16, 32, 40, 64, 80, 128)
"""Beam counts of real sensors; an estimate within 7 % of one is replaced by it."""


def find_beams(
    points_m: NDArray[np.float64], ground_m: float, up: float = 1.0
) -> tuple[int, float] | None:
    """The number of beams of a cloud (n, 3) in metres, and the z of its sensor.

    None if its points form no rings. The ground is at z = `ground_m`. The sensor is searched on the
    z axis, 0.3 m to 4 m above the ground (`up` is −1.0 where z points down). Points on the ground
    are not used for the height, since flat ground seen from z = `ground_m` is one ring, but for the
    count. Beams without a return are not counted.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    far = range_m > NEAR_M
    range_m = range_m[far]
    z_m = points_m[far, 2]
    turn = np.arctan2(points_m[far, 1], points_m[far, 0]) / (2 * np.pi) + 0.5
    voters = np.abs(z_m - ground_m) > 0.4
    if voters.sum() < 500:
        return None
    voting = _slices(turn[voters], VOTING_SLICES)

    def cells(height_m: float) -> int:
        """Occupied cells of azimuth × elevation, seen from that height."""
        rows = int(180 / CELL_DEG)
        elevation_deg = _elevation(z_m[voters] - height_m, range_m[voters])
        occupied = np.zeros(VOTING_SLICES * rows, bool)
        occupied[
            voting * rows + ((elevation_deg + 90) / CELL_DEG).astype(np.int64).clip(0, rows - 1)
        ] = True
        return int(np.count_nonzero(occupied))

    coarse = ground_m + up * np.arange(0.3, 4.0, 0.1)
    occupied = np.array([cells(height) for height in coarse])
    if (1 / occupied).max() < 1.5 * np.median(1 / occupied):
        return None
    fine = coarse[occupied.argmin()] + np.arange(-0.08, 0.09, 0.02)
    height_m = float(fine[np.argmin([cells(height) for height in fine])])
    counting = _slices(turn, COUNTING_SLICES if len(turn) >= SPARSE else COUNTING_SLICES // 3)
    return _count(counting, _elevation(z_m - height_m, range_m)), height_m


def _slices(turn: NDArray[np.float64], slices: int) -> NDArray[np.int64]:
    """Index of the slice (n,) of azimuths given as shares of a full turn (n,)."""
    return (turn * slices).astype(np.int64).clip(0, slices - 1)


def _elevation(rise_m: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees above the horizon."""
    return np.degrees(np.arctan2(rise_m, range_m))


def _count(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    """Number of elevation clusters in the best 1/60 of the slices.

    In most slices some beams point at the sky.
    """
    order = np.lexsort((elevation_deg, slices))
    slices = slices[order]
    elevation_deg = elevation_deg[order]
    starts_beam = np.ones(len(slices), bool)
    starts_beam[1:] = (np.diff(slices) != 0) | (np.diff(elevation_deg) > GAP_DEG)
    counts = np.sort(np.bincount(slices[starts_beam], minlength=VOTING_SLICES))
    estimate = int(counts[-max(1, round(np.count_nonzero(counts) / 60))])
    sensor_count = min(USUAL, key=lambda count: abs(count - estimate))
    return sensor_count if abs(sensor_count - estimate) <= 0.07 * sensor_count else estimate
