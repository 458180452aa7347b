"""Measures the appearance of a sequence's submaps, to check its sensor and frame against the views.

In: points. Out: the degrees of azimuth that they cover, the height of the ground, and the height of
the top. For instance, a ground far from z = 0 shows that the sensor's height is set wrong.
`is_level` distinguishes a level 2-D laser from a 3-D LiDAR.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import PoseColumn, Scans
from pipeline.mapping.gathering import Gathering

MEASURED_SUBMAPS = 9
"""Number of submaps that are measured, evenly spread over a sequence."""
SAMPLED_POINTS = 2000
"""Number of a scan's points that are enough to measure its thickness."""
LEVEL_M = 0.02
"""Points no thicker than this lie in one plane, like those of a level 2-D laser."""
NEAR_M = 15.0
"""Range within which the ground is searched for."""
NEAR_POINTS = 100
"""With fewer points than this within NEAR_M, the ground is searched for among all points."""
BELOW_M = 0.5
MOST_BELOW = 0.2
"""If more than this share of the points near the sensor lie BELOW_M under what would be the ground,
the ground was cut off."""
WIDEST_GAP_DEG = 3.0
"""A wider gap between the azimuths of two points is not covered by the sensor."""


def measure_appearance(
    scans: Scans,
    layout: PoseColumn,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    ground_m: NDArray[np.float64],
    used: NDArray[np.bool_],
) -> dict[str, float]:
    """Return `azimuth_deg`, `ground_m` and `highest_m`, each a median over a few submaps.

    `azimuth_deg` is the degrees of azimuth with points, `ground_m` the z of the ground (NaN if the
    points lie in one plane, or the ground was cut off), and `highest_m` the 99th percentile of z.

    A submap gathers the scans from `first` to `last` (submap,) that are `used` (scan,), placed by
    the poses `layout`. `ground_m` (submap,) is subtracted from all heights.
    """
    measures = []
    measured_rows = []
    if len(last):
        spread = np.linspace(0, len(last) - 1, MEASURED_SUBMAPS).astype(int)
        measured_rows = np.unique(spread).tolist()
    for row in measured_rows:
        rows = slice(row, row + 1)
        gathering = Gathering(scans, layout, first[rows], last[rows], ground_m[rows], used)
        points = next(iter(gathering))
        if len(points):
            range_m = np.hypot(points[:, 0], points[:, 1])
            azimuth_deg = measure_coverage_deg(points[range_m > 0])
            ground_z_m = np.nan
            if measure_thickness_m(points) > LEVEL_M:
                ground_z_m = measure_ground_m(points, range_m)
            near_z_m = points[range_m < NEAR_M, 2]
            below = np.count_nonzero(near_z_m < ground_z_m - BELOW_M)
            if below > MOST_BELOW * len(near_z_m):
                ground_z_m = np.nan
            highest_m = float(np.percentile(points[:, 2], 99))
            measures.append((azimuth_deg, ground_z_m, highest_m))
    if measures:
        azimuth_deg, ground_z_m, highest_m = np.median(measures, axis=0).tolist()
    else:
        azimuth_deg = ground_z_m = highest_m = np.nan
    return {"azimuth_deg": azimuth_deg, "ground_m": ground_z_m, "highest_m": highest_m}


def is_level(sweeps: Iterable[NDArray[np.floating]]) -> bool:
    """Whether scans (n, 3) are sweeps of a level 2-D laser: most have all points in one plane."""
    thicknesses_m = [measure_thickness_m(_sampled(points)) for points in sweeps if len(points)]
    return bool(thicknesses_m) and float(np.median(thicknesses_m)) <= LEVEL_M


def measure_thickness_m(points: NDArray[np.floating]) -> float:
    """Standard deviation in metres of points (n, 3) across the plane that fits them best.

    It is 1 for three points or fewer, which always lie in a plane.
    """
    if len(points) <= 3:
        return 1.0
    # The least eigenvalue is the variance along the normal of the plane.
    variances = np.linalg.eigvalsh(np.cov(points.T)).clip(0)
    return float(np.sqrt(variances)[0])


def measure_ground_m(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> float:
    """Height z in metres of the ground under points (n, 3) at ranges (n,).

    It is where most points near the sensor have about the same z: the ground is flat, walls are
    not.
    """
    near_z_m = points[range_m < NEAR_M, 2]
    if len(near_z_m) < NEAR_POINTS:
        near_z_m = points[:, 2]
    # The densest of all bands 0.25 m high, in steps of 0.05 m; then the median around its middle.
    # Points 20 m from the median are strays, which would make the histogram long.
    z_m = near_z_m[np.abs(near_z_m - np.median(near_z_m)) < 20.0]
    edges = np.arange(z_m.min() - 0.3, z_m.max() + 0.4, 0.05)
    counts = np.convolve(np.histogram(z_m, edges)[0], np.ones(5), "same")
    centre = float(edges[counts.argmax()] + 0.025)  # the middle of the band's middle step
    return float(np.median(z_m[np.abs(z_m - centre) <= 0.2]))


def measure_coverage_deg(points: NDArray[np.float64]) -> float:
    """Degrees of azimuth with points (n, 3): 360 minus all gaps wider than WIDEST_GAP_DEG."""
    if not len(points):
        return 0.0
    azimuth = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    gaps = np.diff(azimuth, append=azimuth[0] + 360.0)
    return float(360.0 - gaps[gaps > WIDEST_GAP_DEG].sum())


def _sampled(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """At most SAMPLED_POINTS of the points (n, 3), drawn at random: rings have a period."""
    if len(points) <= SAMPLED_POINTS:
        return points
    return points[np.random.default_rng(0).integers(len(points), size=SAMPLED_POINTS)]
