"""Finds the ground of a scan: points in, the plane with the most points near it out.

RANSAC (Fischler and Bolles, 1981): planes through three random points are tried, and the one with
the most points near it wins. Steep planes are not tried, since they are walls.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

SURE = 0.9999
"""The search ends once a plane like the best so far would have been found with this probability."""


def find_plane(
    points_m: NDArray[np.float64],
    near_m: float,
    slope_deg: float,
    iterations: int,
    rng: np.random.Generator,
) -> tuple[float, float, float] | None:
    """a, b, c of the plane a x + b y + z = c near which most points (n, 3) lie.

    c is in metres. A point is near if it is closer than `near_m`. At most `iterations` planes are
    tried; planes steeper than `slope_deg` are skipped. Returns None if all of them are steeper, or
    if there are fewer than three points.
    """
    if len(points_m) < 3:
        return None
    x, y, z = points_m.T.astype(np.float32, order="C")
    corners = rng.integers(len(points_m), size=(iterations, 3))
    a, b, c = _best_plane(x, y, z, corners, near_m, math.cos(math.radians(slope_deg)))
    return (a, b, c) if math.isfinite(c) else None


@njit(cache=True, nogil=True, error_model="numpy")
def _best_plane(x, y, z, corners, near_m, min_normal_z):  # type: ignore[no-untyped-def]
    """Return a, b, c of the best plane through `corners` (plane, 3); c is infinite without one."""
    n = len(x)
    most_points = np.int32(0)  # near the best plane
    a_best = np.float32(0)
    b_best = np.float32(0)
    c_best = np.float32(np.inf)
    for number in range(len(corners)):
        i, j, k = corners[number]
        ux = x[j] - x[i]
        uy = y[j] - y[i]
        uz = z[j] - z[i]
        vx = x[k] - x[i]
        vy = y[k] - y[i]
        vz = z[k] - z[i]
        # The normal is the cross product of two edges u and v.
        nx = uy * vz - uz * vy
        ny = uz * vx - ux * vz
        nz = ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0 and abs(nz) >= min_normal_z * length:
            a = np.float32(nx / nz)
            b = np.float32(ny / nz)
            c = a * x[i] + b * y[i] + z[i]
            # Distances are measured along z, where the plane is thicker by the slope.
            margin_m = np.float32(near_m * length / abs(nz))
            count = np.int32(0)
            for point in range(n):
                count += np.int32(abs(a * x[point] + b * y[point] + z[point] - c) < margin_m)
            if count > most_points:
                most_points = count
                a_best = a
                b_best = b
                c_best = c
        # A plane like the best one so far has all three corners near it with the probability
        # share³, and none of all planes so far had them with the probability (1 − share³)^planes.
        missed_probability = (1.0 - (most_points / n) ** 3) ** (number + 1)
        if missed_probability < 1.0 - SURE:
            break
    return a_best, b_best, c_best
