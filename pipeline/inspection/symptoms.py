"""Tests of a cloud (n, 3) in metres for single faults, and the measurements that they need."""

import numpy as np
from numpy.typing import NDArray


def repeated(points: NDArray[np.float64]) -> list[str]:
    """Warnings on points at the origin and on duplicate points."""
    zeros = int((points == 0).all(axis=1).sum())
    others = points[(points != 0).any(axis=1)]
    twice = len(others) - len(np.unique(others.view([("xyz", "V24")]) if others.flags.c_contiguous else others, axis=0))
    found = []
    if zeros > 0.01 * len(points):
        found.append(
            f"points at the origin: {zeros:,} of {len(points):,} are (0, 0, 0), beams without a return; they fill the first bin: "
            "drop them when reading"
        )
    if twice > 0.01 * len(points):
        found.append(
            f"duplicate points: {twice:,} of {len(points):,} stand where another does and count twice in a bin; "
            "was a scan written twice, or padded?"
        )
    return found


def scale(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> str | None:
    """A warning if the unit cannot be metres, else None; `range_m` (n,) are distances from the origin in the xy plane."""
    if np.abs(points).max() <= 1.0 + 1e-6:
        return (
            "normalised cloud: every coordinate within ±1; metres are lost, and so are rings and heights: "
            "use the cloud from before the normalisation"
        )
    if np.median(range_m) > 500:
        return (
            f"not in metres: half of the points are beyond {np.median(range_m):,.0f} m, farther than a LiDAR sees; "
            "are they in millimetres, or in world coordinates?"
        )
    return None


def flat(points: NDArray[np.float64]) -> str | None:
    """A warning if all points lie in one plane, else None."""
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(points.T)).clip(0)) if len(points) > 3 else np.ones(3)
    if spread[0] > 0.02:
        return None
    return (
        f"all points in one plane: {100 * spread[0]:.1f} cm thick; there are no heights to draw a view from: a 2D scan? "
        "Gather its sweeps along the path first"
    )


def ground(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> float:
    """z in metres of the ground: where the points near the sensor are densest in z, as the ground is flat, unlike walls."""
    near = points[range_m < 15.0, 2]
    if len(near) < 100:
        near = points[:, 2]
    z_m = near[np.abs(near - np.median(near)) < 20.0]
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
