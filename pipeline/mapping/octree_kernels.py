"""The hot loops of the dynamic octree (`mapping.octree`; METHODS 4.2 and 4.4).

`cast` walks the rays of a scan through the bricks (`mapping.bricks`) and marks the leaves that they
cross and hit. `update_leaves` then goes once over all leaves, lets them decay and updates the
marked ones.

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

CROSSED = np.uint8(1)
"""Bit of a leaf's mark: a ray crosses it."""
HIT = np.uint8(2)
"""Bit of a leaf's mark: the leaf holds a point."""
RAY_END = 2.0**40
"""Position of a ray's end: positions run from 0 at the sensor to this. They are whole numbers,
which the walk adds three times as fast as floats."""
ENDLESS = 2.0**60
"""Largest distance between two borders, on an axis along which the ray hardly moves."""
NEVER = np.int64(1) << 62
"""A position along a ray beyond every border."""
ZERO = np.int64(0)
UNKNOWN = np.float32(0)
"""The log-odds of an unknown leaf."""
VACANT = np.int64(-1)
"""An empty slot of the hash table of cells."""
KEY_LIMIT = np.int64(1) << 20
"""Bound of a cell's coordinate, in leaves: the hash table's keys have 21 bits for each, signed."""
IN_BRICK = np.int64(LEAVES - 1)
"""The bits of a leaf's key that number it in its brick."""
BRICK_BITS = np.int64(LEAVES.bit_length() - 1)
"""The number of these bits."""


def slot_count(n: int) -> int:
    """The number of slots of a hash table for the cells of n points: a power of two, above 2 n.

    So the table is at most half full.
    """
    return 1 << (2 * n).bit_length()


@njit(cache=True, nogil=True, error_model="numpy")
def cast(
    points: NDArray[np.float64],
    first: int,
    leaves_T_points: NDArray[np.float64],
    origin: NDArray[np.float64],
    lowest_leaf: NDArray[np.int64],
    side: int,
    longest: float,
    every_ray: bool,
    bricks: Bricks,
    bricks_per_ray: int,
    unhit_cells: NDArray[np.int64],
) -> int:
    """Mark the leaves between the sensor and the points as CROSSED, and those of points as HIT.

    points : (n, 3) in metres in the vehicle's frame; those before row `first` are marked already.
    leaves_T_points : (4, 4) maps them to leaves from the cube's lowest corner.
    origin : (3,) the sensor's position in the same frame.
    lowest_leaf : (3,) the cube's lowest leaf, in leaves from odometry's origin.
    side : leaves along an edge of the cube.
    longest : length in leaves at which longer rays are cut; these hit nothing.
    every_ray : one ray to every point; otherwise one to the middle of each cell that holds points.
    bricks : the map, whose marks are written; bricks are allocated where there are none.
    bricks_per_ray : how many new bricks one ray may need.
    unhit_cells : (slots,) hash table of the cells that had a ray but no hit, since they lie outside
        the cube or their rays are cut. It is written to; before the first call all are VACANT.

    Returns the row of the first point that is not marked yet: n, or less if there may not be room
    for another ray's bricks. Returns −1 if a point is not finite or beyond KEY_LIMIT.
    """
    # Names: o is the sensor, c its cell, i the cell of the ray's end, d the ray from o to its end.
    table = bricks.table
    marks = bricks.marks
    levels = bricks.levels
    ox = origin[0]
    oy = origin[1]
    oz = origin[2]
    cx = math.floor(ox)
    cy = math.floor(oy)
    cz = math.floor(oz)
    sensor_key_x, sensor_key_y, sensor_key_z = _parts(cx, cy, cz, lowest_leaf, levels)
    # The parts of the keys of −1 and 1: all bits of an axis, and its lowest bit.
    all_x = part_of_key(-1, 0, levels)
    all_y = part_of_key(-1, 1, levels)
    all_z = part_of_key(-1, 2, levels)
    one_x = part_of_key(1, 0, levels)
    one_y = part_of_key(1, 1, levels)
    one_z = part_of_key(1, 2, levels)
    T = leaves_T_points
    for row in range(first, points.shape[0]):
        if bricks.used[0] + bricks_per_ray > bricks.places.shape[0]:
            return row
        # 1. Move the point, the end of its ray, into the frame of the leaves, and find its cell.
        px = points[row, 0]
        py = points[row, 1]
        pz = points[row, 2]
        end_x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        end_y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        end_z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        if not (abs(end_x) < KEY_LIMIT and abs(end_y) < KEY_LIMIT and abs(end_z) < KEY_LIMIT):
            return -1
        ix = math.floor(end_x)
        iy = math.floor(end_y)
        iz = math.floor(end_z)
        is_inside = min(ix, iy, iz) >= 0 and max(ix, iy, iz) < side
        end_key_x, end_key_y, end_key_z = _parts(ix, iy, iz, lowest_leaf, levels)
        key = end_key_x | end_key_y | end_key_z
        first_leaf = table[np.uint64(key >> BRICK_BITS)]
        # 2. Pass over cells that had a ray already; mark the point's leaf if the ray reaches it.
        if not every_ray:
            if (
                is_inside
                and first_leaf >= 0
                and marks[np.uint64(first_leaf | (key & IN_BRICK))] & HIT
            ):
                continue
            end_x = ix + 0.5
            end_y = iy + 0.5
            end_z = iz + 0.5
        dx = end_x - ox
        dy = end_y - oy
        dz = end_z - oz
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if is_inside and length <= longest:
            if first_leaf < 0:
                first_leaf = allocate(bricks, key >> BRICK_BITS)
            marks[np.uint64(first_leaf | (key & IN_BRICK))] |= HIT
        elif not every_ray:
            cell = ((ix + KEY_LIMIT) << 42) | ((iy + KEY_LIMIT) << 21) | (iz + KEY_LIMIT)
            if not _is_new(unhit_cells, cell):
                continue
        # 3. Cut a ray that is too long.
        if length > longest:
            share = longest / length
            dx = dx * share
            dy = dy * share
            dz = dz * share
            ix = math.floor(ox + dx)
            iy = math.floor(oy + dy)
            iz = math.floor(oz + dz)
        # 4. Find the positions along the ray of the first border on each axis, and the distances
        # from one border to the next. A step is subtracted: x − (−1) is a step forwards.
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
            first_exit = min(exit_x, exit_y, exit_z)
            leaves_on_z = exit_z == first_exit
            leaves_on_y = exit_y == first_exit and not leaves_on_z
            # A border at the very position of the exit counts if it is crossed no later than the
            # one through which the ray leaves.
            stop_z = first_exit + 1
            stop_y = first_exit if leaves_on_z else first_exit + 1
            stop_x = first_exit if leaves_on_z or leaves_on_y else first_exit + 1
            steps_z = _steps(next_z, spacing_z, stop_z)
            steps_y = _steps(next_y, spacing_y, stop_y)
            steps_x = _steps(next_x, spacing_x, stop_x)
            steps = min(steps, steps_x + steps_y + steps_z)

        # 6. Walk, from the sensor's own leaf to the one before the end.
        at_x = sensor_key_x
        at_y = sensor_key_y
        at_z = sensor_key_z
        for _ in range(steps):
            key = at_x | at_y | at_z
            first_leaf = table[np.uint64(key >> BRICK_BITS)]
            if first_leaf < 0:
                first_leaf = allocate(bricks, key >> BRICK_BITS)
            marks[np.uint64(first_leaf | (key & IN_BRICK))] |= CROSSED
            if next_z <= min(next_x, next_y):
                at_z = (at_z - step_z) & all_z
                next_z += spacing_z
            elif next_y <= next_x:
                at_y = (at_y - step_y) & all_y
                next_y += spacing_y
            else:
                at_x = (at_x - step_x) & all_x
                next_x += spacing_x
    return len(points)


@njit(inline="always", error_model="numpy")
def _parts(x, y, z, lowest_leaf, levels):  # type: ignore[no-untyped-def]
    """The parts on each axis of the key of the leaf (x, y, z) of the cube."""
    return (
        part_of_key(x + lowest_leaf[0], 0, levels),
        part_of_key(y + lowest_leaf[1], 1, levels),
        part_of_key(z + lowest_leaf[2], 2, levels),
    )


@njit(inline="always", error_model="numpy")
def _is_new(cells, cell):  # type: ignore[no-untyped-def]
    """Add a cell's key to the hash table `cells`; returns whether it was not in it yet."""
    last_slot = np.uint64(cells.shape[0] - 1)
    slot = ((np.uint64(cell) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)) & last_slot
    while cells[slot] != VACANT and cells[slot] != cell:
        slot = (slot + np.uint64(1)) & last_slot
    is_new = cells[slot] == VACANT
    cells[slot] = cell
    return is_new


@njit(inline="always", error_model="numpy")
def _spacing(travel):  # type: ignore[no-untyped-def]
    """Distance along a ray between two borders of an axis on which it travels `travel` leaves."""
    return np.int64(min(RAY_END / abs(travel), ENDLESS))


@njit(inline="always", error_model="numpy")
def _border(start, cell, travel, spacing):  # type: ignore[no-untyped-def]
    """Position along a ray of its first border on an axis; it begins at `start`, in `cell`."""
    return np.int64(((cell + 1 - start) if travel > 0 else (start - cell)) * spacing)


@njit(inline="always", error_model="numpy")
def _exit(cell, end, travel, first_border, spacing, side):  # type: ignore[no-untyped-def]
    """Position along a ray at which it leaves the cube on an axis, or NEVER.

    The ray goes from `cell` to `end` on this axis, and crosses its first border at `first_border`.
    A ray that ends in an outermost cell has an exit too: positions are rounded, so the walk could
    otherwise cross this border instead of the last one on another axis.
    """
    if travel > 0:
        return first_border + (side - 1 - cell) * spacing if end >= side - 1 else NEVER
    return first_border + cell * spacing if end <= 0 else NEVER


@njit(inline="always", error_model="numpy")
def _steps(first_border, spacing, stop):  # type: ignore[no-untyped-def]
    """Number of borders on an axis that a ray crosses before the position `stop`."""
    return max((stop - first_border + spacing - 1) // spacing, ZERO)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def update_leaves(
    bricks: Bricks,
    kept_share: np.float32,
    known_from: np.float32,
    hit_log_odds: np.float32,
    miss_log_odds: np.float32,
    min_log_odds: np.float32,
    max_log_odds: np.float32,
) -> None:
    """Decay, update and clamp the log-odds of all leaves in place (METHODS 4.4).

    A leaf's log-odds are multiplied by `kept_share`, set to 0 if their absolute value is then less
    than `known_from`, added to `hit_log_odds` or `miss_log_odds` if the leaf is marked, and clamped
    from `min_log_odds` to `max_log_odds`. Marks are cleared, and bricks whose leaves are all
    unknown are freed.
    """
    # Backwards, since the last brick takes the position of one that is freed.
    for brick in range(bricks.used[0] - 1, -1, -1):
        first_leaf = brick * LEAVES
        any_known = np.int32(0)
        log_odds = bricks.log_odds[first_leaf : first_leaf + LEAVES]
        marks = bricks.marks[first_leaf : first_leaf + LEAVES]
        for leaf in range(LEAVES):
            value = log_odds[leaf] * kept_share
            mark = np.int32(marks[leaf])
            value = value if abs(value) >= known_from else UNKNOWN
            # A leaf that is crossed and hit counts as hit.
            value += hit_log_odds if mark >= np.int32(HIT) else (miss_log_odds if mark else UNKNOWN)
            value = min(max(value, min_log_odds), max_log_odds)
            any_known |= np.int32(value != UNKNOWN)
            log_odds[leaf] = value
            marks[leaf] = np.uint8(0)
        if not any_known:
            free(bricks, brick)
