"""The hot loops of Scan Context: the height of every bin, and the means of points in voxels.

`bin_heights` first finds each bin in float32, with a polynomial for the arc tangent that the
compiler turns into SIMD. For points so near to the border of a bin that float32 may err, the bin is
then found again in float64, so that bins are exact at every border. The maximum of each bin is
taken in four separate tables: successive points often share a bin, and in one table each would wait
for the previous write.

`voxel_means` finds the cube of every point with a hash table.
"""

import math

import numpy as np
from numba import njit, uint32
from numpy.typing import NDArray

BLOCK = 512
"""Points handled at once, so that their intermediate results stay in the L1 cache."""
LOWEST = np.float32(-1e30)
"""The height of an empty bin in the tables, below every real one."""
# coefficients of t, t³, …, t¹¹ in the polynomial for arctan t on [0, 1]
A0 = np.float32(0.99997726)
A1 = np.float32(-0.33262347)
A2 = np.float32(0.19354346)
A3 = np.float32(-0.11643287)
A4 = np.float32(0.05265332)
A5 = np.float32(-0.0117212)
HALF_PI = np.float32(math.pi / 2)
PI = np.float32(math.pi)
TAU = np.float32(2 * math.pi)
NAN_SAFE = {"reassoc", "contract", "arcp", "nsz", "afn"}
"""The fast-math flags under which NaN and infinity keep their meaning."""
ZERO = np.float32(0)
HALF = np.float32(0.5)
TINY = np.float32(1e-30)
"""Added to a divisor, so that it is never 0; too small to change any other divisor."""
HUGE = np.float32(1e12)
"""Bins of points higher than this (m) are found in float64, where NaN and infinity are refused."""
FAR_RINGS = np.float32(2e6)
"""Ranges are capped at this many rings, so that they fit int32."""
SECTOR_ERROR = np.float32(5e-6)
"""Bound on the error of a float32 azimuth, as a share of one turn."""
RING_ERROR = np.float32(8e-7)
"""Bound on the error of a float32 range, as a share of the largest range."""


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, boundscheck=False, error_model="numpy")
def bin_heights(points, rings, sectors, max_range_m, clamp, min_points):  # type: ignore[no-untyped-def]
    """Highest z (rings × sectors,) in metres in each bin of points, and whether all are finite.

    `points` (3 n,) are x y z x y z … in metres, float32 or float64; heights are rounded to float32.
    The bin of ring r and sector s is number r · sectors + s. A bin with fewer than `min_points`
    points has height 0. Points beyond `max_range_m` count to the last ring if `clamp`.
    """
    bins = rings * sectors
    # four tables, each with one more entry for the points outside all bins
    stride = uint32(bins + 1)
    table = np.full(4 * stride, LOWEST, np.float32)
    counts = np.zeros(bins + 1, np.uint32)
    ids = np.empty(BLOCK, np.uint32)
    xs = np.empty(BLOCK, np.float32)
    ys = np.empty(BLOCK, np.float32)
    zs = np.empty(BLOCK, np.float32)
    is_near_border = np.zeros(BLOCK, np.uint8)
    eights_near_border = is_near_border.view(np.uint64)  # eight points at a glance
    per_radian = np.float32(sectors / (2 * math.pi))
    per_metre = np.float32(rings / max_range_m)
    # A position in a bin is sure if it is nearer to the bin's middle than these.
    sector_edge = HALF - SECTOR_ERROR * np.float32(sectors)
    ring_edge = HALF - RING_ERROR * np.float32(rings)
    last_ring = np.int32(rings - 1)
    sector_count = np.int32(sectors)
    # A point outside has ring == rings, which is no ring, unless it is clamped to the last one.
    ring_of_outside = np.int32(rings - 1) if clamp else np.int32(rings)
    outside_bin = np.int32(bins)
    n = points.shape[0] // 3
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        block = points[3 * start : 3 * (start + m)]
        # 1. Copy the coordinates of the block to one array for each axis.
        for i in range(m):
            xs[i] = block[3 * i]
            ys[i] = block[3 * i + 1]
            zs[i] = block[3 * i + 2]
        # 2. Find the bins in float32, and which of them float32 may have got wrong.
        for i in range(m):
            x = xs[i]
            y = ys[i]
            sector_position = _azimuth(x, y) * per_radian
            sector = np.int32(sector_position)
            # What is left is the position within the sector. Azimuth 2π lands on a border, so step
            # 3 redoes it; capped ranges likewise.
            sector_position -= np.float32(sector)
            ring_position = min(np.sqrt(x * x + y * y) * per_metre, FAR_RINGS)
            ring = np.int32(ring_position)
            ring_position -= np.float32(ring)
            ring = ring if ring <= last_ring else ring_of_outside
            ids[i] = uint32(ring * sector_count + sector if ring <= last_ring else outside_bin)
            is_sure = (
                (abs(sector_position - HALF) <= sector_edge)
                & (abs(ring_position - HALF) <= ring_edge)
                & (abs(zs[i]) < HUGE)
            )
            is_near_border[i] = np.uint8(not is_sure)
        # 3. Find the bins of points near a border again in float64.
        for eight in range((m + 7) // 8):
            if eights_near_border[eight]:
                for i in range(8 * eight, min(8 * eight + 8, m)):
                    if is_near_border[i]:
                        x = np.float64(block[3 * i])
                        y = np.float64(block[3 * i + 1])
                        z = np.float64(block[3 * i + 2])
                        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
                            return table[:bins], False
                        ids[i] = _exact_bin(x, y, rings, sectors, max_range_m, clamp)
        # 4. Count the points of each bin, if a bin needs more than one.
        if min_points > 1:
            for i in range(m):
                counts[ids[i]] += uint32(1)
        # 5. Raise the bins' heights; point i goes to table i mod 4.
        whole_fours = m & ~3
        for i in range(0, whole_fours, 4):
            for copy in range(4):
                entry = ids[i + copy] + uint32(copy) * stride
                z = zs[i + copy]
                height = table[entry]
                table[entry] = height if height > z else z
        for i in range(whole_fours, m):
            entry = ids[i]
            z = zs[i]
            height = table[entry]
            table[entry] = height if height > z else z
    # 6. Join the four tables, and set bins with too few points to 0.
    for k in range(bins):
        height = max(
            max(table[k], table[k + stride]),
            max(table[k + uint32(2) * stride], table[k + uint32(3) * stride]),
        )
        table[k] = (
            height if height > LOWEST and (min_points <= 1 or counts[k] >= min_points) else ZERO
        )
    return table[:bins], True


@njit(inline="always", fastmath=NAN_SAFE, error_model="numpy")
def _azimuth(x, y):  # type: ignore[no-untyped-def]
    """Azimuth of (x, y) in radians, in [0, 2π], exact to about 2e-6 turns."""
    ax = abs(x)
    ay = abs(y)
    steep = ay > ax
    high = ay if steep else ax
    low = ax if steep else ay
    t = low / (high + TINY)
    s = t * t
    angle = (((((A5 * s + A4) * s + A3) * s + A2) * s + A1) * s + A0) * t
    angle = HALF_PI - angle if steep else angle
    angle = PI - angle if x < ZERO else angle
    return TAU - angle if y < ZERO else angle


# Without fastmath=False the caller's fast-math would apply.
@njit(cache=True, nogil=True, fastmath=False, error_model="numpy")
def _exact_bin(x, y, rings, sectors, max_range_m, clamp):  # type: ignore[no-untyped-def]
    """The number of the bin of (x, y) in float64 (METHODS 1.1).

    x, y and `max_range_m` are in metres. The ring is floor(range / ring's width). The sector is
    ceil(azimuth / sector's width), counted from 1, and 1 for an azimuth of 0. Points beyond the
    last ring count to it if `clamp`, else they get the number after the last bin. So does the
    origin, which has no azimuth.
    """
    r = math.sqrt(x * x + y * y)
    ring = int(r / (max_range_m / rings)) if r < 2.0 * max_range_m else rings
    if ring >= rings:
        if not clamp:
            return uint32(rings * sectors)
        ring = rings - 1
    if r == 0.0:
        return uint32(rings * sectors)
    theta = math.degrees(math.atan2(y, x))
    theta = theta + 360.0 if theta < 0.0 else theta
    sector = min(max(np.int64(math.ceil(theta / (360.0 / sectors))), 1), sectors) - 1
    return uint32(ring * sectors + sector)


@njit(cache=True, nogil=True, error_model="numpy")
def voxel_means(points: NDArray[np.floating], side_m: float) -> NDArray[np.float64]:
    """Mean (cube, 3) of the points (n, 3), n > 0, in each occupied cube of `side_m`; in metres.

    The cubes begin at the lowest corner of all points, and come in the order of their first points.
    Sums are float64. A hash table with open addressing maps a cube's key to its number. It starts
    small and grows: one slot per point up front was slower, since page faults took twice the time
    of the sums.
    """
    n = points.shape[0]
    n_cubes = np.uint64(0)
    sums = np.empty((n, 3), np.float64)
    counts = np.empty(n, np.int64)
    # the hash table: the key and the number of the cube in each slot, −1 if it is empty
    slot_keys = np.empty(16 * BLOCK, np.int64)
    slot_cubes = np.full(16 * BLOCK, -1, np.int32)
    x0 = points[0, 0]
    y0 = points[0, 1]
    z0 = points[0, 2]
    for i in range(n):
        x0 = min(x0, points[i, 0])
        y0 = min(y0, points[i, 1])
        z0 = min(z0, points[i, 2])
    xs = np.empty(BLOCK)
    ys = np.empty(BLOCK)
    zs = np.empty(BLOCK)
    keys = np.empty(BLOCK, np.int64)
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        for i in range(m):
            xs[i] = points[start + i, 0]
            ys[i] = points[start + i, 1]
            zs[i] = points[start + i, 2]
        # 1. The key of a cube is its three coordinates, 21 bits each.
        for i in range(m):
            x = np.int64((xs[i] - x0) / side_m)
            y = np.int64((ys[i] - y0) / side_m)
            z = np.int64((zs[i] - z0) / side_m)
            keys[i] = (x << 42) ^ (y << 21) ^ z
        # 2. Keep the table at most half full, even if each point of the block opens a cube.
        if 2 * (n_cubes + np.uint64(m)) > slot_cubes.shape[0]:
            slot_keys, slot_cubes = _enlarge(slot_keys, slot_cubes)
        # 3. Find each point's cube, or open a new one, and add the point to its sums.
        last_slot = np.uint64(slot_cubes.shape[0] - 1)
        for i in range(m):
            key = keys[i]
            slot = _first_slot(key, slot_cubes.shape[0])
            while slot_cubes[slot] >= 0 and slot_keys[slot] != key:
                slot = (slot + np.uint64(1)) & last_slot
            if slot_cubes[slot] < 0:
                slot_keys[slot] = key
                slot_cubes[slot] = np.int32(n_cubes)
                sums[n_cubes, 0] = 0.0
                sums[n_cubes, 1] = 0.0
                sums[n_cubes, 2] = 0.0
                counts[n_cubes] = 0
                n_cubes += np.uint64(1)
            cube = np.uint32(slot_cubes[slot])
            sums[cube, 0] += xs[i]
            sums[cube, 1] += ys[i]
            sums[cube, 2] += zs[i]
            counts[cube] += 1
    means = np.empty((n_cubes, 3), np.float64)
    for number in range(n_cubes):
        for axis in range(3):
            means[number, axis] = sums[number, axis] / counts[number]
    return means


@njit(cache=True, nogil=True)
def _enlarge(keys, cubes):  # type: ignore[no-untyped-def]
    """The same hash table with four times as many slots; `voxel_means` explains both arrays."""
    new_keys = np.empty(4 * keys.shape[0], np.int64)
    new_cubes = np.full(4 * cubes.shape[0], -1, np.int32)
    for old_slot in range(cubes.shape[0]):
        if cubes[old_slot] >= 0:
            slot = _first_slot(keys[old_slot], new_keys.shape[0])
            while new_cubes[slot] >= 0:
                slot = (slot + np.uint64(1)) & np.uint64(new_keys.shape[0] - 1)
            new_keys[slot] = keys[old_slot]
            new_cubes[slot] = cubes[old_slot]
    return new_keys, new_cubes


@njit(inline="always")
def _first_slot(key, slots):  # type: ignore[no-untyped-def]
    """First slot to probe for a key, by Fibonacci hashing; `slots` is a power of two."""
    # The factor is 2^64 / golden ratio. The upper bits of the product are the best mixed: >> 40
    # keeps the upper 24, and the mask takes as many of them as the table needs.
    return ((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) & np.uint64(
        slots - 1
    )
