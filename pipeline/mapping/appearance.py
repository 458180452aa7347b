"""Numbers that show whether a sensor or a frame suits the views.

They describe what the submaps of a sequence look like.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import PoseColumn, Scans
from pipeline.mapping.gathering import Gathering

LOOKED_AT = 9
"""Submaps of a sequence, evenly spread."""
TELLING = 2000
"""So many of a scan's points tell whether it is a sweep."""
LEVEL_M = 0.02
"""Points no thicker than this lie in one plane, like a sweep of a level 2-D LiDAR."""


def appearance(
    scans: Scans,
    layout: PoseColumn,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    ground_m: NDArray[np.float64],
    used: NDArray[np.bool_],
) -> dict[str, float]:
    """Medians over a few submaps of `azimuth_deg`, `ground_m` and `highest_m`.

    The submaps gather the `used` (scan,) of scans `first` to `last` (submap,), laid out by these
    poses; `ground_m` (submap,) is the height of the ground in each anchor's frame.

    The medians are of degrees of azimuth with points, and of z of the ground and of the top. The
    ground is NaN where the points lie in one plane; the top is the 99th percentile of the heights.
    """
    measures = []
    for row in np.unique(np.linspace(0, len(last) - 1, LOOKED_AT).astype(int)) if len(last) else ():
        rows = slice(row, row + 1)
        gathering = Gathering(scans, layout, first[rows], last[rows], ground_m[rows], used)
        points = next(iter(gathering))
        if len(points):
            range_m = np.hypot(points[:, 0], points[:, 1])
            has_ground = thickness(points) > LEVEL_M
            ground_z_m = ground(points, range_m) if has_ground else np.nan
            highest_m = float(np.percentile(points[:, 2], 99))
            measures.append((coverage(points[range_m > 0]), ground_z_m, highest_m))
    medians = np.median(np.reshape(measures, (-1, 3)), axis=0) if measures else [np.nan] * 3
    names = ("azimuth_deg", "ground_m", "highest_m")
    return dict(zip(names, map(float, medians), strict=True))


def is_level(sweeps: Iterable[NDArray[np.floating]]) -> bool:
    """Whether most of some scans' points (n, 3) lie in one plane each: those of a level laser."""
    thicknesses_m = [thickness(_some(points)) for points in sweeps if len(points)]
    return bool(thicknesses_m) and float(np.median(thicknesses_m)) <= LEVEL_M


def _some(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """TELLING of the points (n, 3), drawn at random: each 32nd may be of one ring."""
    if len(points) <= TELLING:
        return points
    return points[np.random.default_rng(0).integers(len(points), size=TELLING)]


def thickness(points: NDArray[np.floating]) -> float:
    """Standard deviation in metres of points (n, 3) across their best plane; 1 of too few."""
    return (
        float(np.sqrt(np.linalg.eigvalsh(np.cov(points.T)).clip(0))[0]) if len(points) > 3 else 1.0
    )


def ground(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> float:
    """z in metres of the ground: where points near the sensor are densest in z.

    The ground is flat, unlike walls.
    """
    near_z_m = points[range_m < 15.0, 2]
    if len(near_z_m) < 100:
        near_z_m = points[:, 2]
    z_m = near_z_m[np.abs(near_z_m - np.median(near_z_m)) < 20.0]
    edges = np.arange(z_m.min() - 0.3, z_m.max() + 0.4, 0.05)
    counts = np.convolve(np.histogram(z_m, edges)[0], np.ones(5), "same")
    centre = float(edges[counts.argmax()] + 0.025)
    return float(np.median(z_m[np.abs(z_m - centre) <= 0.2]))


def coverage(points: NDArray[np.float64]) -> float:
    """Degrees of azimuth with points: 360 minus all gaps wider than 3°."""
    if not len(points):
        return 0.0
    azimuth = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    gaps = np.diff(azimuth, append=azimuth[0] + 360.0)
    return float(360.0 - gaps[gaps > 3.0].sum())
