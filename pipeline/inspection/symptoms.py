"""Tests of a cloud (n, 3) in metres for single faults."""

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.appearance import LEVEL_M, thickness


def repeated(points: NDArray[np.float64]) -> list[str]:
    """Warnings on points at the origin and on duplicate points."""
    zeros = int((points == 0).all(axis=1).sum())
    off_origin = points[(points != 0).any(axis=1)]
    duplicates = len(off_origin) - len(
        np.unique(
            off_origin.view([("xyz", "V24")]) if off_origin.flags.c_contiguous else off_origin,
            axis=0,
        )
    )
    warnings = []
    if zeros > 0.01 * len(points):
        warnings.append(
            f"points at the origin: {zeros:,} of {len(points):,} are (0, 0, 0), beams without a "
            "return; they fill the first bin: drop them when reading"
        )
    if duplicates > 0.01 * len(points):
        warnings.append(
            f"duplicate points: {duplicates:,} of {len(points):,} stand where another does and "
            "count twice in a bin; was a scan written twice, or padded?"
        )
    return warnings


def scale(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> str | None:
    """A warning if the unit cannot be metres, else None.

    `range_m` (n,) are distances from the origin in the xy plane.
    """
    if np.abs(points).max() <= 1.0 + 1e-6:
        return (
            "normalised cloud: every coordinate within ±1; metres are lost, and so are rings and "
            "heights: use the cloud from before the normalisation"
        )
    if np.median(range_m) > 500:
        return (
            f"not in metres: half of the points are beyond {np.median(range_m):,.0f} m, farther "
            "than a LiDAR sees; are they in millimetres, or in world coordinates?"
        )
    return None


def flat(points: NDArray[np.float64]) -> str | None:
    """A warning if all points lie in one plane, else None."""
    thick_m = thickness(points)
    if thick_m > LEVEL_M:
        return None
    return (
        f"all points in one plane: {100 * thick_m:.1f} cm thick; there are no heights to draw a "
        "view from: a 2D scan? Gather its sweeps along the path first"
    )
