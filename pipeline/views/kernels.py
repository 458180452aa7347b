"""The hot loops of Scan Context: voxel means, and the bin of every point, exact at every border.

A bin is first found in float32 with a polynomial arc tangent that the compiler turns into SIMD;
points nearer to a border than that can err are redone in float64. Four private tables break the
store-to-load chain of the maximum.
"""

import math

import numpy as np
from numba import njit, uint32
from numpy.typing import NDArray

BLOCK = 512
LOWEST = np.float32(-1e30)
A0 = np.float32(0.99997726)
A1 = np.float32(-0.33262347)
A2 = np.float32(0.19354346)
A3 = np.float32(-0.11643287)
A4 = np.float32(0.05265332)
A5 = np.float32(-0.0117212)
HALF_PI = np.float32(math.pi / 2)
PI = np.float32(math.pi)
TAU = np.float32(2 * math.pi)
NAN_SAFE = {
    "reassoc",
    "contract",
    "arcp",
    "nsz",
    "afn",
}  # fast-math, but NaN and infinity keep their meaning
ZERO = np.float32(0)
HALF = np.float32(0.5)
TINY = np.float32(1e-30)
HUGE = np.float32(1e12)
SECTOR_ERROR = np.float32(5e-6)
RING_ERROR = np.float32(8e-7)
"""Of one turn, of the range: bounds on the float32 estimates."""


@njit(inline="always", fastmath=NAN_SAFE, error_model="numpy")
def _azimuth(x, y):  # type: ignore[no-untyped-def]
    """Azimuth in [0, 2π] to about 2e-6 turns."""
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


@njit(
    cache=True, nogil=True, fastmath=False, error_model="numpy"
)  # said, since else the caller's flags are inherited
def _exact_bin(x, y, rings, sectors, max_range_m, clamp):  # type: ignore[no-untyped-def]
    """METHODS 1.1 in float64: ring floor(r / width), sector ceil(theta / width) with 0 → 1; the
    origin has no azimuth."""
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


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, boundscheck=False, error_model="numpy")
def bin_heights(points, rings, sectors, max_range_m, clamp, least):  # type: ignore[no-untyped-def]
    """Highest z of each bin (rings × sectors,), 0 where fewer than `least` points lie; and whether
    all points were finite.

    `points` is x y z x y z … in float32 or float64; heights are rounded to float32.
    """
    bins = rings * sectors
    stride = uint32(bins + 1)
    table = np.full(4 * stride, LOWEST, np.float32)
    counts = np.zeros(bins + 1, np.uint32)
    ids = np.empty(BLOCK, np.uint32)
    xs = np.empty(BLOCK, np.float32)
    ys = np.empty(BLOCK, np.float32)
    zs = np.empty(BLOCK, np.float32)
    is_near_border = np.zeros(BLOCK, np.uint8)
    unsure = is_near_border.view(np.uint64)  # eight points at a glance
    per_radian = np.float32(sectors / (2 * math.pi))
    per_metre = np.float32(rings / max_range_m)
    sector_edge = HALF - SECTOR_ERROR * np.float32(sectors)
    ring_edge = HALF - RING_ERROR * np.float32(rings)
    last_ring = np.int32(rings - 1)
    columns = np.int32(sectors)
    outside = np.int32(rings - 1) if clamp else np.int32(rings)
    outside_bin = np.int32(bins)
    n = points.shape[0] // 3
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        block = points[3 * start : 3 * (start + m)]
        for i in range(m):
            xs[i] = block[3 * i]
            ys[i] = block[3 * i + 1]
            zs[i] = block[3 * i + 2]
        for i in range(m):
            x = xs[i]
            y = ys[i]
            turn = _azimuth(x, y) * per_radian
            sector = np.int32(turn)
            turn -= np.float32(sector)  # a turn of all sectors is at a border, and redone
            ring_position = min(np.sqrt(x * x + y * y) * per_metre, np.float32(2e6))
            ring = np.int32(ring_position)
            ring_position -= np.float32(ring)  # what is cut is at a border, and redone
            ring = ring if ring <= last_ring else outside
            ids[i] = uint32(ring * columns + sector if ring <= last_ring else outside_bin)
            sure = (
                (abs(turn - HALF) <= sector_edge)
                & (abs(ring_position - HALF) <= ring_edge)
                & (abs(zs[i]) < HUGE)
            )
            is_near_border[i] = np.uint8(not sure)
        for eight in range((m + 7) // 8):
            if unsure[eight]:
                for i in range(8 * eight, min(8 * eight + 8, m)):
                    if is_near_border[i]:
                        x = np.float64(block[3 * i])
                        y = np.float64(block[3 * i + 1])
                        z = np.float64(block[3 * i + 2])
                        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
                            return table[:bins], False
                        ids[i] = _exact_bin(x, y, rings, sectors, max_range_m, clamp)
        if least > 1:
            for i in range(m):
                counts[ids[i]] += uint32(1)
        whole_fours = m & ~3
        for i in range(0, whole_fours, 4):
            for copy in range(4):
                a = ids[i + copy] + uint32(copy) * stride
                z = zs[i + copy]
                v = table[a]
                table[a] = v if v > z else z
        for i in range(whole_fours, m):
            a = ids[i]
            z = zs[i]
            v = table[a]
            table[a] = v if v > z else z
    for k in range(bins):
        v = max(
            max(table[k], table[k + stride]),
            max(table[k + uint32(2) * stride], table[k + uint32(3) * stride]),
        )
        table[k] = v if v > LOWEST and (least <= 1 or counts[k] >= least) else ZERO
    return table[:bins], True


@njit(inline="always")
def _slot(key, slots):  # type: ignore[no-untyped-def]
    return ((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)) & np.uint64(
        slots - 1
    )


@njit(cache=True, nogil=True)
def _wider(keys, heads):  # type: ignore[no-untyped-def]
    """A hash table of four times as many slots."""
    new_keys = np.empty(4 * keys.shape[0], np.int64)
    new_heads = np.full(4 * heads.shape[0], -1, np.int32)
    for old_slot in range(heads.shape[0]):
        if heads[old_slot] >= 0:
            slot = _slot(keys[old_slot], new_keys.shape[0])
            while new_heads[slot] >= 0:
                slot = (slot + np.uint64(1)) & np.uint64(new_keys.shape[0] - 1)
            new_keys[slot] = keys[old_slot]
            new_heads[slot] = heads[old_slot]
    return new_keys, new_heads


@njit(cache=True, nogil=True, error_model="numpy")
def voxel_means(points: NDArray[np.floating], side_m: float) -> NDArray[np.float64]:
    """Mean of the points (n, 3) in each occupied cube of `side_m`; the grid starts at the minimum
    corner.

    Cubes come in the order of their first points; sums are float64. A hash table with open
    addressing finds them. It starts small and grows, since touching fresh memory for a slot a point
    took twice as long as all the sums.
    """
    n = points.shape[0]
    n_cubes = np.uint64(0)
    sums = np.empty((n, 3), np.float64)
    counts = np.empty(n, np.int64)
    keys = np.empty(16 * BLOCK, np.int64)
    heads = np.full(16 * BLOCK, -1, np.int32)
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
    cubes = np.empty(BLOCK, np.int64)
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        for i in range(m):
            xs[i] = points[start + i, 0]
            ys[i] = points[start + i, 1]
            zs[i] = points[start + i, 2]
        for i in range(m):
            x = np.int64((xs[i] - x0) / side_m)
            y = np.int64((ys[i] - y0) / side_m)
            z = np.int64((zs[i] - z0) / side_m)
            cubes[i] = (x << 42) ^ (y << 21) ^ z
        if 2 * (n_cubes + np.uint64(m)) > heads.shape[0]:
            keys, heads = _wider(keys, heads)
        last_slot = np.uint64(heads.shape[0] - 1)
        for i in range(m):
            key = cubes[i]
            slot = _slot(key, heads.shape[0])
            while heads[slot] >= 0 and keys[slot] != key:
                slot = (slot + np.uint64(1)) & last_slot
            if heads[slot] < 0:
                keys[slot] = key
                heads[slot] = np.int32(n_cubes)
                sums[n_cubes, 0] = 0.0
                sums[n_cubes, 1] = 0.0
                sums[n_cubes, 2] = 0.0
                counts[n_cubes] = 0
                n_cubes += np.uint64(1)
            voxel = np.uint32(heads[slot])
            sums[voxel, 0] += xs[i]
            sums[voxel, 1] += ys[i]
            sums[voxel, 2] += zs[i]
            counts[voxel] += 1
    means = np.empty((n_cubes, 3), np.float64)
    for cube in range(n_cubes):
        for axis in range(3):
            means[cube, axis] = sums[cube, axis] / counts[cube]
    return means
