"""Estimates the height of a spinning LiDAR and the number of its beams from the points alone.

1. Height: a beam has the same elevation angle in all directions only if the angle is measured from
   the sensor. So the sensor is at the height from which the points fall into the fewest cells of
   azimuth × elevation.
2. Beams: seen from there, the beams in a slice of one degree of azimuth are separate clusters of
   elevation, and can be counted.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HEIGHT_SLICES = 72
COUNTING_SLICES = 360
"""Slices of azimuth in 360°.

Wide ones hold enough points of each beam to find the height, in narrow ones the beams are separate.
"""
FEW_POINTS = 20_000
"""In clouds with fewer points the beams are counted in slices three times as wide."""
CELL_DEG = 0.05
"""Elevation of a cell."""
GAP_DEG = 0.2
"""Neighbouring beams are further apart than this: 0.33° on an HDL-64, 0.35° on 128 beams over
45°."""
NEAR_M = 3.0
"""Nearer points are not used: there the offset of a laser inside the housing is not negligible."""
GROUND_M = 0.4
"""Points this near to the ground's height are not used to find the sensor's height: flat ground,
seen from its own height, is one ring."""
MIN_POINTS = 500
"""With fewer points for it the height is not looked for."""
SENSOR_COUNTS = (1, 4, 8, 16, 32, 40, 64, 80, 128)
"""Beam counts of real sensors; an estimate within 7 % of one is replaced by it."""


class Beams(NamedTuple):
    """The beams of a cloud, and its sensor."""

    number: int
    """How many beams have returns."""
    sensor_z_m: float


def find_beams(points_m: NDArray[np.float64], ground_m: float, up: float = 1.0) -> Beams | None:
    """The number of beams of a cloud (n, 3) in metres, and the z of its sensor.

    None if its points form no rings. The ground is at z = `ground_m`. The sensor is searched on the
    z axis, 0.3 m to 4 m above the ground; `up` is −1.0 where z points down.
    """
    range_m = np.hypot(points_m[:, 0], points_m[:, 1])
    is_far = range_m > NEAR_M
    range_m = range_m[is_far]
    z_m = points_m[is_far, 2]
    turns = np.arctan2(points_m[is_far, 1], points_m[is_far, 0]) / (2 * np.pi) + 0.5
    is_off_ground = np.abs(z_m - ground_m) > GROUND_M
    if is_off_ground.sum() < MIN_POINTS:
        return None
    sensor_z_m = _sensor_z_m(
        turns[is_off_ground], range_m[is_off_ground], z_m[is_off_ground], ground_m, up
    )
    if sensor_z_m is None:
        return None
    slice_count = COUNTING_SLICES if len(turns) >= FEW_POINTS else COUNTING_SLICES // 3
    elevation_deg = _elevation_deg(z_m - sensor_z_m, range_m)
    return Beams(_beam_count(_slices(turns, slice_count), elevation_deg), sensor_z_m)


def _sensor_z_m(
    turns: NDArray[np.float64],
    range_m: NDArray[np.float64],
    z_m: NDArray[np.float64],
    ground_m: float,
    up: float,
) -> float | None:
    """The height from which points (n,) fill the fewest cells; None if no height stands out."""
    slices = _slices(turns, HEIGHT_SLICES)
    row_count = int(180 / CELL_DEG)

    def occupied_cells(height_m: float) -> int:
        elevation_deg = _elevation_deg(z_m - height_m, range_m)
        elevation_rows = ((elevation_deg + 90) / CELL_DEG).astype(np.int64).clip(0, row_count - 1)
        is_occupied = np.zeros(HEIGHT_SLICES * row_count, bool)
        is_occupied[slices * row_count + elevation_rows] = True
        return int(np.count_nonzero(is_occupied))

    coarse_m = ground_m + up * np.arange(0.3, 4.0, 0.1)
    cell_counts = np.array([occupied_cells(height_m) for height_m in coarse_m])
    # the best height stands out if it fills two thirds of the cells that the others fill, or fewer
    if (1 / cell_counts).max() < 1.5 * np.median(1 / cell_counts):
        return None
    fine_m = coarse_m[cell_counts.argmin()] + np.arange(-0.08, 0.09, 0.02)
    return float(fine_m[np.argmin([occupied_cells(height_m) for height_m in fine_m])])


def _beam_count(slices: NDArray[np.int64], elevation_deg: NDArray[np.float64]) -> int:
    """The number of beams of points (n,) with the index of their slice and their elevation."""
    # It is the number of clusters of elevation in the best 1/60 of the slices, since in most slices
    # some beams point at the sky.
    order = np.lexsort((elevation_deg, slices))
    slices = slices[order]
    elevation_deg = elevation_deg[order]
    starts_beam = np.ones(len(slices), bool)
    starts_beam[1:] = (np.diff(slices) != 0) | (np.diff(elevation_deg) > GAP_DEG)
    counts = np.sort(np.bincount(slices[starts_beam], minlength=HEIGHT_SLICES))
    estimate = int(counts[-max(1, round(np.count_nonzero(counts) / 60))])
    sensor_count = min(SENSOR_COUNTS, key=lambda count: abs(count - estimate))
    is_close = abs(sensor_count - estimate) <= 0.07 * sensor_count
    return sensor_count if is_close else estimate


def _slices(turns: NDArray[np.float64], slice_count: int) -> NDArray[np.int64]:
    """Index of the slice (n,) of azimuths given as shares of a full turn (n,)."""
    return (turns * slice_count).astype(np.int64).clip(0, slice_count - 1)


def _elevation_deg(
    rise_m: NDArray[np.float64], range_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Elevation angles (n,) over the horizon."""
    return np.degrees(np.arctan2(rise_m, range_m))
