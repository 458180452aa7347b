"""The ground of a scan: the plane that most of its points lie on.

RANSAC: Fischler and Bolles, 1981.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

SURE = 0.9999
"""Planes are tried until the ground was missed by all of them with a chance below 1 − this, were it
the best one so far."""


def plane(
    points_m: NDArray[np.float64],
    near_m: float,
    slope_deg: float,
    iterations: int,
    rng: np.random.Generator,
) -> tuple[float, float, float] | None:
    """a, b, c of the plane a x + b y + z = c near which most points (n, 3) lie, else None.

    Nearer than `near_m`. None where no plane is flat enough. Planes through three random points are
    tried, steeper ones than `slope_deg` passed over, `iterations` at most.
    """
    if len(points_m) < 3:
        return None
    x, y, z = points_m.T.astype(np.float32, order="C")
    corners = rng.integers(len(points_m), size=(iterations, 3))
    a, b, c = _plane(x, y, z, corners, near_m, math.cos(math.radians(slope_deg)))
    return (a, b, c) if math.isfinite(c) else None


@njit(cache=True, nogil=True, error_model="numpy")
def _plane(x, y, z, corners, plane_m, least_upright):  # type: ignore[no-untyped-def]
    """The best plane's a, b, c; c is infinite for no plane.

    `corners` (tried, 3) index points (n,); a plane's normal has z of at least `least_upright`.
    """
    n = len(x)
    most_points = np.int32(0)
    a_best = np.float32(0)
    b_best = np.float32(0)
    c_best = np.float32(np.inf)
    missed = 1.0
    for number in range(len(corners)):
        i, j, k = corners[number]
        ux = x[j] - x[i]
        uy = y[j] - y[i]
        uz = z[j] - z[i]
        vx = x[k] - x[i]
        vy = y[k] - y[i]
        vz = z[k] - z[i]
        nx = uy * vz - uz * vy
        ny = uz * vx - ux * vz
        nz = ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0 and abs(nz) >= least_upright * length:
            a = np.float32(nx / nz)
            b = np.float32(ny / nz)
            c = a * x[i] + b * y[i] + z[i]
            margin_m = np.float32(plane_m * length / abs(nz))
            count = np.int32(0)
            for point in range(n):
                count += np.int32(abs(a * x[point] + b * y[point] + z[point] - c) < margin_m)
            if count > most_points:
                most_points = count
                a_best = a
                b_best = b
                c_best = c
        missed = (1.0 - (most_points / n) ** 3) ** (number + 1)
        if missed < 1.0 - SURE:
            break
    return a_best, b_best, c_best
