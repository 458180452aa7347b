"""The hot loops of the dynamic octree: rays that mark what a scan crossed and hit, and one sweep that updates the leaves.

Rays walk a dense window of bytes as in Amanatides and Woo (1987), with selects in place of branches. Around the window stands a
wall one leaf thick that ends every ray which leaves it. Lengths are in leaves, from the window's lowest corner.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FREE, HIT, SEEN, WALL = np.uint8(1), np.uint8(2), np.uint8(4), np.uint8(8)
"""Bits of a leaf's byte in `marks`: crossed by a ray, holds a point, end of an earlier ray, outside the window."""
WHOLE, ENDLESS = 2.0**40, 2.0**60
"""Positions along a ray are integers, three times as fast as floats: its end, and a number beyond every border."""
ZERO, NOTHING, VACANT = np.int64(0), np.float32(0), np.int64(-1)
REACH = np.int64(1) << 20
"""Leaves on an axis, either way, that the hash key of a cell outside the window has bits for."""


def walled(side: int) -> NDArray[np.uint8]:
    """Empty marks (side + 2, side + 2, side + 2) of a window, in its wall."""
    marks = np.full((side + 2,) * 3, WALL, np.uint8)
    marks[1:-1, 1:-1, 1:-1] = 0
    return marks


def room(points: int) -> int:
    """Slots of a hash table that so many cells leave half empty: a power of two."""
    return 1 << (2 * points).bit_length()


@njit(cache=True, nogil=True, error_model="numpy")
def cast(
    points: NDArray[np.float64],
    leaves_T_points: NDArray[np.float64],
    origin: NDArray[np.float64],
    reach: float,
    every_ray: bool,
    marks: NDArray[np.uint8],
    beyond: NDArray[np.int64],
    box: NDArray[np.int64],
) -> bool:
    """Mark the leaves between `origin` (3,) and points (n, 3) FREE, of points HIT; False if one is not finite or out of REACH.

    A ray longer than `reach` is cut there and hits nothing. Unless `every_ray`, there is one for each cell that holds points, to
    its middle. `box` (2, 3) becomes the lowest and highest leaf that may be marked.
    """
    w = marks.shape[0]
    flat, side = marks.reshape(-1), w - 2
    slots = beyond.shape[0]
    if not every_ray:
        beyond[:] = VACANT
    ox, oy, oz = origin[0], origin[1], origin[2]
    cx, cy, cz = math.floor(ox), math.floor(oy), math.floor(oz)
    lowest_x, lowest_y, lowest_z, highest_x, highest_y, highest_z = cx, cy, cz, cx, cy, cz
    first = np.uint64(((cx + 1) * w + cy + 1) * w + cz + 1)
    T = leaves_T_points
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if not (abs(x) < REACH and abs(y) < REACH and abs(z) < REACH):
            return False
        ix, iy, iz = math.floor(x), math.floor(y), math.floor(z)
        inside = min(ix, iy, iz) >= 0 and max(ix, iy, iz) < side
        end = np.uint64(((ix + 1) * w + iy + 1) * w + iz + 1) if inside else np.uint64(0)
        if not every_ray:
            if inside:
                if flat[end] & SEEN:
                    continue
                flat[end] |= SEEN
            else:
                key = ((ix + REACH) << 42) | ((iy + REACH) << 21) | (iz + REACH)
                slot = ((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & np.uint64(slots - 1)
                while beyond[slot] != VACANT and beyond[slot] != key:
                    slot = (slot + np.uint64(1)) & np.uint64(slots - 1)
                if beyond[slot] == key:
                    continue
                beyond[slot] = key
            x, y, z = ix + 0.5, iy + 0.5, iz + 0.5
        lowest_x, highest_x = min(lowest_x, ix), max(highest_x, ix)
        lowest_y, highest_y = min(lowest_y, iy), max(highest_y, iy)
        lowest_z, highest_z = min(lowest_z, iz), max(highest_z, iz)
        dx, dy, dz = x - ox, y - oy, z - oz
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length > reach:
            share = reach / length
            dx, dy, dz = dx * share, dy * share, dz * share
            ix, iy, iz = math.floor(ox + dx), math.floor(oy + dy), math.floor(oz + dz)
        elif inside:
            flat[end] |= HIT
        step_x, step_y = np.uint64(w * w if dx > 0 else -w * w), np.uint64(w if dy > 0 else -w)
        step_z = np.uint64(1 if dz > 0 else -1)
        every_x, every_y, every_z = _spacing(dx), _spacing(dy), _spacing(dz)
        next_x, next_y, next_z = _border(ox, cx, dx, every_x), _border(oy, cy, dy, every_y), _border(oz, cz, dz, every_z)
        k = first
        for _ in range(abs(ix - cx) + abs(iy - cy) + abs(iz - cz)):
            mark = flat[k]
            if mark & WALL:
                break
            flat[k] = mark | FREE
            low_y = next_y <= next_x
            low_xy = next_y if low_y else next_x
            low_z = next_z <= low_xy
            step = step_y if low_y else step_x
            k += step_z if low_z else step
            next_z += every_z if low_z else ZERO
            next_y += every_y if low_y & (not low_z) else ZERO
            next_x += ZERO if low_y | low_z else every_x
    box[0, 0], box[0, 1], box[0, 2] = max(lowest_x, 0), max(lowest_y, 0), max(lowest_z, 0)
    box[1, 0], box[1, 1], box[1, 2] = min(highest_x, side - 1), min(highest_y, side - 1), min(highest_z, side - 1)
    return True


@njit(inline="always", error_model="numpy")
def _spacing(along):  # type: ignore[no-untyped-def]
    """Share of a ray from one border to the next, of an axis that it moves `along` leaves of."""
    return np.int64(min(WHOLE / abs(along), ENDLESS))


@njit(inline="always", error_model="numpy")
def _border(start, cell, along, every):  # type: ignore[no-untyped-def]
    """Share of a ray to the first border; `start` is in `cell`."""
    return np.int64(((cell + 1 - start) if along > 0 else (start - cell)) * every)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def sweep(
    log_odds: NDArray[np.float32],
    marks: NDArray[np.uint8],
    box: NDArray[np.int64],
    shift: NDArray[np.int64],
    kept: np.float32,
    least: np.float32,
    hit: np.float32,
    miss: np.float32,
    lowest: np.float32,
    highest: np.float32,
) -> None:
    """Move, decay, update and clamp the leaves of `box` (2, 3: lowest, highest) in place, and clear their marks (METHODS 4.4).

    A leaf takes the value `shift` (3,) leaves further on, unknown from beyond the window; times `kept`; 0 where less than `least`
    is left; plus `hit` or `miss`. Leaves outside the box must be unknown before and after.
    """
    side = log_odds.shape[0]
    leaves, flat = log_odds.reshape(-1), marks.reshape(-1)
    row = np.zeros(3 * side, np.float32)
    bottom, height = side + box[0, 2], np.uint64(box[1, 2] + 1 - box[0, 2])
    ahead = bottom + min(max(shift[2], -side), side)
    for count_x in range(box[1, 0] - box[0, 0] + 1):
        x = box[0, 0] + count_x if shift[0] >= 0 else box[1, 0] - count_x
        for count_y in range(box[1, 1] - box[0, 1] + 1):
            y = box[0, 1] + count_y if shift[1] >= 0 else box[1, 1] - count_y
            old_x, old_y = x + shift[0], y + shift[1]
            old = np.uint64((old_x * side + old_y) * side + box[0, 2])
            here = min(old_x, old_y) >= 0 and max(old_x, old_y) < side
            for z in range(height):
                row[np.uint64(bottom) + z] = leaves[old + z] if here else NOTHING
            new = np.uint64((x * side + y) * side + box[0, 2])
            mark = np.uint64(((x + 1) * (side + 2) + y + 1) * (side + 2) + box[0, 2] + 1)
            for z in range(height):
                value, seen = row[np.uint64(ahead) + z] * kept, np.int32(flat[mark + z])
                value = value if abs(value) >= least else NOTHING
                value += hit if seen & np.int32(HIT) else (miss if seen & np.int32(FREE) else NOTHING)
                leaves[new + z] = min(max(value, lowest), highest)
                flat[mark + z] = np.uint8(0)
