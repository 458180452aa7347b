"""The hot loops of the dynamic octree (`mapping.octree`; METHODS 4.2 and 4.4).

`cast` walks the rays of a scan through the bricks (`mapping.bricks`) and marks the leaves that they
cross and hit. `sweep` then goes once over all leaves, lets them decay and updates the marked ones.

Rays are walked as in Amanatides and Woo (1987): whichever of the next borders on the three axes is
nearest is crossed. Lengths are in leaves, from the lowest corner of the cube. A leaf's key holds
its coordinate on each axis as a binary number with gaps between the bits. A step is a subtraction,
which borrows across the gaps, and an AND, which clears them again. So it costs no more than in a
dense array, and wraps around the torus.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.mapping.bricks import LEAVES, Bricks, allocate, free, part_of_key

FREE = np.uint8(1)
"""Bit of a leaf's mark: a ray crosses it."""
HIT = np.uint8(2)
"""Bit of a leaf's mark: it holds a point."""
WHOLE = 2.0**40
"""The end of a ray. Positions along it are whole numbers, three times as fast as floats."""
ENDLESS = 2.0**60
"""Largest distance between two borders, on an axis along which the ray hardly moves."""
NEVER = np.int64(1) << 62
"""A position along a ray beyond every border."""
ZERO = np.int64(0)
NOTHING = np.float32(0)
VACANT = np.int64(-1)
"""An empty slot of the hash table of cells."""
REACH = np.int64(1) << 20
"""Largest coordinate of a cell, in leaves, that the hash table's keys have bits for."""
IN_BRICK = np.int64(LEAVES - 1)
"""The bits of a leaf's key that number it in its brick."""
BRICK_BITS = np.int64(LEAVES.bit_length() - 1)
"""How many these are."""


def room(points: int) -> int:
    """Slots of a hash table that is at most half full with this many cells: a power of two."""
    return 1 << (2 * points).bit_length()


@njit(cache=True, nogil=True, error_model="numpy")
def cast(
    points: NDArray[np.float64],
    done: int,
    leaves_T_points: NDArray[np.float64],
    origin: NDArray[np.float64],
    lowest: NDArray[np.int64],
    side: int,
    reach: float,
    every_ray: bool,
    bricks: Bricks,
    most: int,
    seen: NDArray[np.int64],
) -> int:
    """Mark the leaves between the sensor and the points as FREE, and those of points as HIT.

    points : (n, 3) in the vehicle's frame, of which the first `done` are marked already.
    leaves_T_points : (4, 4) maps them to leaves from the cube's lowest corner.
    origin : (3,) the sensor there.
    lowest : (3,) the cube's lowest leaf, in leaves from odometry's origin.
    side : leaves along an edge of the cube.
    reach : length in leaves at which longer rays are cut; these hit nothing.
    every_ray : one ray to every point; otherwise one to the middle of each cell that holds points.
    most : how many new bricks one ray may need.
    seen : (slots,) hash table of cells that hold points but no hit, VACANT before the first call.

    Returns how many points are done: n, or fewer if there may not be room for another ray's bricks;
    −1 if a point is not finite or out of REACH.
    """
    # Below, o is the sensor and c its cell, p the point and i its cell, d the ray from o to its
    # end.
    table = bricks.table
    marks = bricks.marks
    levels = bricks.levels
    ox = origin[0]
    oy = origin[1]
    oz = origin[2]
    cx = math.floor(ox)
    cy = math.floor(oy)
    cz = math.floor(oz)
    first_x, first_y, first_z = _parts(cx, cy, cz, lowest, levels)
    # The parts of the keys of −1 and 1: all bits of an axis, and its lowest bit.
    all_x = part_of_key(-1, 0, levels)
    all_y = part_of_key(-1, 1, levels)
    all_z = part_of_key(-1, 2, levels)
    one_x = part_of_key(1, 0, levels)
    one_y = part_of_key(1, 1, levels)
    one_z = part_of_key(1, 2, levels)
    T = leaves_T_points
    for i in range(done, points.shape[0]):
        if bricks.used[0] + most > bricks.places.shape[0]:
            return i
        # 1. Move the point into the frame of the leaves, and find its cell.
        px = points[i, 0]
        py = points[i, 1]
        pz = points[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if not (abs(x) < REACH and abs(y) < REACH and abs(z) < REACH):
            return -1
        ix = math.floor(x)
        iy = math.floor(y)
        iz = math.floor(z)
        inside = min(ix, iy, iz) >= 0 and max(ix, iy, iz) < side
        end_x, end_y, end_z = _parts(ix, iy, iz, lowest, levels)
        key = end_x | end_y | end_z
        begin = table[np.uint64(key >> BRICK_BITS)]
        # 2. Pass over cells that had a ray already; mark the point's leaf if the ray reaches it.
        if not every_ray:
            if inside and begin >= 0 and marks[np.uint64(begin | (key & IN_BRICK))] & HIT:
                continue
            x = ix + 0.5
            y = iy + 0.5
            z = iz + 0.5
        dx = x - ox
        dy = y - oy
        dz = z - oz
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if inside and length <= reach:
            if begin < 0:
                begin = allocate(bricks, key >> BRICK_BITS)
            marks[np.uint64(begin | (key & IN_BRICK))] |= HIT
        elif not every_ray:
            cell = ((ix + REACH) << 42) | ((iy + REACH) << 21) | (iz + REACH)
            if not _is_new(seen, cell):
                continue
        # 3. Cut a ray that is too long.
        if length > reach:
            share = reach / length
            dx = dx * share
            dy = dy * share
            dz = dz * share
            ix = math.floor(ox + dx)
            iy = math.floor(oy + dy)
            iz = math.floor(oz + dz)
        # 4. Find the positions along the ray of the first border on each axis, and the distances
        # from one border to the next. Subtracting the key of −1 is a step forwards.
        step_x = all_x if dx > 0 else one_x
        step_y = all_y if dy > 0 else one_y
        step_z = all_z if dz > 0 else one_z
        spacing_x = _spacing(dx)
        spacing_y = _spacing(dy)
        spacing_z = _spacing(dz)
        next_x = _border(ox, cx, dx, spacing_x)
        next_y = _border(oy, cy, dy, spacing_y)
        next_z = _border(oz, cz, dz, spacing_z)

        # 5. Count the steps to the end, or to where the ray leaves the cube. Of borders at the same
        # position z is crossed first, then y, then x.
        steps = abs(ix - cx) + abs(iy - cy) + abs(iz - cz)
        if min(ix, iy, iz) < 1 or max(ix, iy, iz) > side - 2:
            exit_x = _exit(cx, ix, dx, next_x, spacing_x, side)
            exit_y = _exit(cy, iy, dy, next_y, spacing_y, side)
            exit_z = _exit(cz, iz, dz, next_z, spacing_z, side)
            leave = min(exit_x, exit_y, exit_z)
            # A border at the very position where the ray leaves counts on the axes that are crossed
            # before the one on which it leaves.
            steps_z = _steps(next_z, spacing_z, leave + 1)
            steps_y = _steps(next_y, spacing_y, leave + (exit_z > leave))
            steps_x = _steps(next_x, spacing_x, leave + (min(exit_y, exit_z) > leave))
            steps = min(steps, steps_x + steps_y + steps_z)

        # 6. Walk, from the sensor's own leaf to the one before the end.
        x = first_x
        y = first_y
        z = first_z
        for _ in range(steps):
            key = x | y | z
            begin = table[np.uint64(key >> BRICK_BITS)]
            if begin < 0:
                begin = allocate(bricks, key >> BRICK_BITS)
            marks[np.uint64(begin | (key & IN_BRICK))] |= FREE
            if next_z <= min(next_x, next_y):
                z = (z - step_z) & all_z
                next_z += spacing_z
            elif next_y <= next_x:
                y = (y - step_y) & all_y
                next_y += spacing_y
            else:
                x = (x - step_x) & all_x
                next_x += spacing_x
    return len(points)


@njit(inline="always", error_model="numpy")
def _parts(x, y, z, lowest, levels):  # type: ignore[no-untyped-def]
    """The parts on each axis of the key of the leaf (x, y, z) of the cube."""
    return (
        part_of_key(x + lowest[0], 0, levels),
        part_of_key(y + lowest[1], 1, levels),
        part_of_key(z + lowest[2], 2, levels),
    )


@njit(inline="always", error_model="numpy")
def _is_new(seen, cell):  # type: ignore[no-untyped-def]
    """Add a cell to the hash table of cells; returns whether it was not in it yet."""
    last_slot = np.uint64(seen.shape[0] - 1)
    slot = ((np.uint64(cell) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & last_slot
    while seen[slot] != VACANT and seen[slot] != cell:
        slot = (slot + np.uint64(1)) & last_slot
    is_new = seen[slot] == VACANT
    seen[slot] = cell
    return is_new


@njit(inline="always", error_model="numpy")
def _spacing(travel):  # type: ignore[no-untyped-def]
    """Distance along a ray between two borders of an axis on which it travels `travel` leaves."""
    return np.int64(min(WHOLE / abs(travel), ENDLESS))


@njit(inline="always", error_model="numpy")
def _border(start, cell, travel, spacing):  # type: ignore[no-untyped-def]
    """Position along a ray of its first border on an axis; it begins at `start`, in `cell`."""
    return np.int64(((cell + 1 - start) if travel > 0 else (start - cell)) * spacing)


@njit(inline="always", error_model="numpy")
def _exit(cell, end, travel, first_border, spacing, side):  # type: ignore[no-untyped-def]
    """Position along a ray at which it leaves the cube on an axis, or NEVER.

    The ray goes from `cell` to `end` on this axis, and crosses its first border at `first_border`.
    """
    if travel > 0:
        return first_border + (side - 1 - cell) * spacing if end >= side - 1 else NEVER
    return first_border + cell * spacing if end <= 0 else NEVER


@njit(inline="always", error_model="numpy")
def _steps(first_border, spacing, stop):  # type: ignore[no-untyped-def]
    """Number of borders on an axis that a ray crosses before the position `stop`."""
    return max((stop - first_border + spacing - 1) // spacing, ZERO)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def sweep(
    bricks: Bricks,
    kept_share: np.float32,
    least: np.float32,
    hit: np.float32,
    miss: np.float32,
    lowest: np.float32,
    highest: np.float32,
) -> None:
    """Decay, update and clamp the log-odds of all leaves in place (METHODS 4.4).

    A leaf's log-odds are multiplied by `kept_share`, set to 0 if less than `least` is left, added
    to `hit` or `miss` if the leaf is marked, and clamped from `lowest` to `highest`. Marks are
    cleared, and bricks whose leaves are all unknown are freed.
    """
    for brick in range(bricks.used[0] - 1, -1, -1):
        first_leaf = brick * LEAVES
        any_known = np.int32(0)
        log_odds = bricks.log_odds[first_leaf : first_leaf + LEAVES]
        marks = bricks.marks[first_leaf : first_leaf + LEAVES]
        for leaf in range(LEAVES):
            value = log_odds[leaf] * kept_share
            mark = np.int32(marks[leaf])
            value = value if abs(value) >= least else NOTHING
            value += hit if mark >= np.int32(HIT) else (miss if mark else NOTHING)
            value = min(max(value, lowest), highest)
            any_known |= np.int32(value != NOTHING)
            log_odds[leaf] = value
            marks[leaf] = np.uint8(0)
        if not any_known:
            free(bricks, brick)
