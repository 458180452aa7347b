"""Intersections of a ray with one shape, in closed form: one function for each kind of shape.

Each returns the range at which the shape stops the ray, MISS if it does not, and the
cosine of incidence. Ranges are in metres, and directions are unit vectors.

A porous shape stops a ray after a random free path of −log(u) / extinction (Beer–Lambert), so that
foliage needs no single leaves. The u in (0, 1) comes from a hash, so that the result does not
depend on the order in which rays are cast.
"""

from typing import Any, TypeAlias

import numpy as np
from numba import njit

MISS = -1.0
"""The range of a ray that misses."""
LEAF_COSINE = 0.8
"""Cosine of incidence in a porous shape."""
_PARALLEL = 1e-12
"""A smaller component of a direction counts as 0."""

Vector: TypeAlias = tuple[float, float, float]
"""x, y and z in the world."""


@njit(cache=True, nogil=True, error_model="numpy")
def hash_u(seed: np.uint64, ray: int, draw: int) -> float:
    """A pseudo-random number in (0, 1) that depends on the three arguments alone.

    They are mixed by the finaliser of splitmix64.
    """
    word = (
        np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
        ^ (np.uint64(ray) + np.uint64(0x632BE59BD9B4E019)) * np.uint64(0xBF58476D1CE4E5B9)
        ^ (np.uint64(draw) + np.uint64(0x2545F4914F6CDD1D)) * np.uint64(0x94D049BB133111EB)
    )
    word ^= word >> np.uint64(30)
    word *= np.uint64(0xBF58476D1CE4E5B9)
    word ^= word >> np.uint64(27)
    word *= np.uint64(0x94D049BB133111EB)
    word ^= word >> np.uint64(31)
    # The upper 53 bits, as many as a float holds, over 2^53; 0.5 keeps the number above 0.
    return (float(word >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True, nogil=True, error_model="numpy")
def hit_box(box: Any, origin: Vector, direction: Vector, u: float) -> tuple[float, float]:
    """Range and cosine where a ray is stopped by a box, solid or porous.

    A ray that starts inside the box misses it.
    """
    (ox, oy, oz) = origin
    (dx, dy, dz) = direction
    # Turn the ray into the frame of the box, and intersect it with its three slabs.
    ahead = ox - box.x_m
    left = oy - box.y_m
    along = dx * box.cos_yaw + dy * box.sin_yaw
    across = dy * box.cos_yaw - dx * box.sin_yaw
    in_x, out_x = _slab(
        ahead * box.cos_yaw + left * box.sin_yaw, along, -box.half_length_m, box.half_length_m
    )
    in_y, out_y = _slab(
        left * box.cos_yaw - ahead * box.sin_yaw, across, -box.half_width_m, box.half_width_m
    )
    if max(in_x, in_y) > min(out_x, out_y):
        return MISS, 0.0
    in_z, out_z = _slab(oz, dz, box.bottom_m, box.top_m)
    enter = max(in_x, in_y, in_z)
    leave = min(out_x, out_y, out_z)
    if enter > leave or enter <= 0:
        return MISS, 0.0
    if box.extinction_per_m > 0:
        enter -= np.log(u) / box.extinction_per_m
        return (enter, LEAF_COSINE) if enter <= leave else (MISS, 0.0)
    cosine = along if enter == in_x else (across if enter == in_y else dz)
    return enter, abs(cosine)


@njit(cache=True, nogil=True, error_model="numpy")
def hit_cylinder(cylinder: Any, origin: Vector, direction: Vector) -> tuple[float, float]:
    """Range and cosine where a ray meets the side of an upright cylinder; its caps are open."""
    (ox, oy, oz) = origin
    (dx, dy, dz) = direction
    # Seen from above the cylinder is a circle. With the ray's level length `level2`, squared, the
    # axis lies `aside` / √level2 beside the ray, and the ray cuts a chord of 2 √(depth2 / level2).
    east = cylinder.x_m - ox
    north = cylinder.y_m - oy
    level2 = dx * dx + dy * dy
    aside = east * dy - north * dx
    depth2 = cylinder.radius_m * cylinder.radius_m * level2 - aside * aside
    if depth2 <= 0:
        return MISS, 0.0
    enter = (east * dx + north * dy - np.sqrt(depth2)) / level2
    z = oz + enter * dz
    if enter <= 0 or z < cylinder.bottom_m or z > cylinder.top_m:
        return MISS, 0.0
    return enter, np.sqrt(depth2 / level2) / cylinder.radius_m


@njit(cache=True, nogil=True, error_model="numpy")
def hit_crown(crown: Any, origin: Vector, direction: Vector, u: float) -> tuple[float, float]:
    """Range and cosine where a ray is stopped inside a porous ellipsoid."""
    (ox, oy, oz) = origin
    (dx, dy, dz) = direction
    # Scale the ellipsoid to the unit sphere; p is the ray's start and v its direction.
    px = (ox - crown.x_m) / crown.radius_m
    py = (oy - crown.y_m) / crown.radius_m
    vx = dx / crown.radius_m
    vy = dy / crown.radius_m
    pz = (oz - crown.z_m) / crown.half_height_m
    vz = dz / crown.half_height_m
    # |p + range v|² = 1 is a quadratic equation: a range² + 2 b range + |p|² − 1 = 0.
    a = vx * vx + vy * vy + vz * vz
    b = px * vx + py * vy + pz * vz
    depth2 = b * b - a * (px * px + py * py + pz * pz - 1.0)
    if depth2 <= 0:
        return MISS, 0.0
    leave = (np.sqrt(depth2) - b) / a
    if leave <= 0:
        return MISS, 0.0
    # A ray that starts inside the crown enters it at range 0.
    stop = max((-b - np.sqrt(depth2)) / a, 0.0) - np.log(u) / crown.extinction_per_m
    return (stop, LEAF_COSINE) if stop <= leave else (MISS, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _slab(start: float, step: float, low: float, high: float) -> tuple[float, float]:
    """The ranges at which a ray enters and leaves the slab low <= start + range × step <= high."""
    if abs(step) < _PARALLEL:
        return (-np.inf, np.inf) if low <= start <= high else (np.inf, -np.inf)
    at_low = (low - start) / step
    at_high = (high - start) / step
    return (at_low, at_high) if at_low < at_high else (at_high, at_low)
