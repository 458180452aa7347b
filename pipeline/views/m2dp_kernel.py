"""The hot loops of M2DP: a cloud's moments, and the bin of every point on every plane, exact at
every border.

A point's sector follows from the signs of its two coordinates and one slope, its circle from the
fourth root of r², both in float32 that the compiler turns into SIMD; points nearer to a border than
that can err are redone in float64. All planes look at one block of points while it lies in the L1
cache; four private tables break the store-to-load chain of the counts.
"""

import math

import numpy as np
from numba import njit, uint32

BLOCK = 256
COPIES = 4
QUICK = 16
"""Sectors that signs and a slope tell apart.

Any other number of them is found in float64 throughout.
"""
GRAY = np.array([0, 1, 3, 2])
"""Sector within a quadrant, from the axis +x or −x on, by two bits: steeper than 45°; 22.5° off the
nearer axis."""
PLACE = np.argsort(np.concatenate([8 + GRAY, 15 - GRAY, 7 - GRAY, GRAY])).astype(np.uint32)
"""Where a sector of QUICK is counted: two bits of signs (y, x negative), then those of GRAY."""
SLOPE = np.float32(math.tan(math.pi / 8))
ZERO = np.float32(0)
HALF = np.float32(0.5)
ERROR = np.float32(1e-6)
"""Bound on the error of a float32 coordinate or slope, in units of the largest distance."""
ROUNDS = 10_000
CLOSE = 1e-12
"""Of the power iteration: no more of them, nor once no number changes by more."""
NAN_SAFE = {
    "reassoc",
    "contract",
    "arcp",
    "nsz",
    "afn",
}  # fast-math, but NaN and infinity keep their meaning


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, error_model="numpy")
def moments(points):  # type: ignore[no-untyped-def]
    """Mean (3,), scatter matrix (3, 3) about it, and the largest distance from it."""
    n = points.shape[0]
    x0 = y0 = z0 = 0.0
    for i in range(n):
        x0 += points[i, 0]
        y0 += points[i, 1]
        z0 += points[i, 2]
    x0 = x0 / n
    y0 = y0 / n
    z0 = z0 / n
    xx = yy = zz = xy = xz = yz = 0.0
    farthest = 0.0
    for i in range(n):
        x = points[i, 0] - x0
        y = points[i, 1] - y0
        z = points[i, 2] - z0
        xx += x * x
        yy += y * y
        zz += z * z
        xy += x * y
        xz += x * z
        yz += y * z
        farthest = max(farthest, x * x + y * y + z * z)
    scatter = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return np.array((x0, y0, z0)), scatter, math.sqrt(farthest)


@njit(
    cache=True, nogil=True, fastmath=False, error_model="numpy"
)  # said, since else the caller's flags are inherited
def _exact_bin(u, v, radii, angles, place):  # type: ignore[no-untyped-def]
    """METHODS 3.1 in float64: borders belong to the bin above them, and the last bin takes what is
    beyond."""
    rho = math.sqrt(u * u + v * v)
    theta = math.atan2(v + 0.0, u + 0.0)  # no negative zero
    ring = len(radii) - 2
    sector = len(angles) - 2
    while ring > 0 and rho < radii[ring]:
        ring -= 1
    while sector > 0 and theta < angles[sector]:
        sector -= 1
    return uint32(ring * len(place) + place[sector])


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, boundscheck=False, error_model="numpy")
def bin_counts(  # type: ignore[no-untyped-def]
    points, mean, axes, farthest_m, planes, radii, angles, place
):
    """How many of the points (n, 3) fall into each bin of each plane: tables (plane, COPIES ·
    circle · sector) to be added up.

    Sectors are in the order of `place`. Points are taken from their mean, the farthest of them
    `farthest_m` away, and turned by `axes` (3, 3), whose columns are the new axes; `planes` (plane,
    2, 3) are each plane's x and y in those; `radii` (circle + 1,) and `angles` (sector + 1,) are
    the borders.
    """
    n = points.shape[0]
    sectors = len(place)
    circles = len(radii) - 1
    stride = uint32(circles * sectors)
    tables = np.zeros((len(planes), COPIES * stride), np.uint32)
    exact = np.empty((BLOCK, 3), np.float64)
    xs = np.empty(BLOCK, np.float32)
    ys = np.empty(BLOCK, np.float32)
    zs = np.empty(BLOCK, np.float32)
    ids = np.empty(BLOCK, np.uint32)
    is_near_border = np.empty(BLOCK, np.uint8)
    quick = sectors == QUICK
    unit = 1.0 / farthest_m
    n_circles = np.float32(circles)
    last_ring = np.int32(circles - 1)
    columns = np.int32(sectors)
    edge = HALF - ERROR * np.float32(circles * circles)
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        for i in range(m):
            x = points[start + i, 0] - mean[0]
            y = points[start + i, 1] - mean[1]
            z = points[start + i, 2] - mean[2]
            a = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
            b = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
            c = x * axes[0, 2] + y * axes[1, 2] + z * axes[2, 2]
            exact[i, 0] = a
            exact[i, 1] = b
            exact[i, 2] = c
            xs[i] = np.float32(a * unit)
            ys[i] = np.float32(b * unit)
            zs[i] = np.float32(c * unit)
        for p in range(len(planes)):
            ux = np.float32(planes[p, 0, 0])
            uy = np.float32(planes[p, 0, 1])
            uz = np.float32(planes[p, 0, 2])
            vx = np.float32(planes[p, 1, 0])
            vy = np.float32(planes[p, 1, 1])
            vz = np.float32(planes[p, 1, 2])
            table = tables[p]
            for i in range(m):
                u = ux * xs[i] + uy * ys[i] + uz * zs[i]
                v = vx * xs[i] + vy * ys[i] + vz * zs[i]
                across = abs(v)
                along = abs(u)
                steep = across > along
                high = across if steep else along
                low = along if steep else across
                slope = low - SLOPE * high
                code = np.int32(slope > ZERO)
                code |= np.int32(2) if steep else np.int32(0)
                code |= np.int32(4) if u < ZERO else np.int32(0)
                code |= np.int32(8) if v < ZERO else np.int32(0)
                ring_position = np.sqrt(np.sqrt(u * u + v * v)) * n_circles
                ring = min(np.int32(ring_position), last_ring)
                ring_position -= np.float32(ring)
                ids[i] = uint32(ring * columns + code)
                margin = min(min(low, high - low), abs(slope))
                is_near_border[i] = np.uint8((margin < ERROR) | (abs(ring_position - HALF) > edge))
            borders = np.int32(0)
            for i in range(m):
                borders += np.int32(is_near_border[i])
            if borders > 0 or not quick:
                for i in range(m):
                    if is_near_border[i] or not quick:
                        x = exact[i, 0]
                        y = exact[i, 1]
                        z = exact[i, 2]
                        u = planes[p, 0, 0] * x + planes[p, 0, 1] * y + planes[p, 0, 2] * z
                        v = planes[p, 1, 0] * x + planes[p, 1, 1] * y + planes[p, 1, 2] * z
                        ids[i] = _exact_bin(u, v, radii, angles, place)
            whole_fours = m & ~3
            for i in range(0, whole_fours, COPIES):
                for copy in range(COPIES):
                    table[ids[i + copy] + uint32(copy) * stride] += uint32(1)
            for i in range(whole_fours, m):
                table[ids[i]] += uint32(1)
    return tables


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, error_model="numpy")
def leading(shares):  # type: ignore[no-untyped-def]
    """The first singular vectors (m,), (n,) of a matrix (m, n) without negative entries, which have
    none either.

    Power iteration from a positive vector finds them (Perron and Frobenius); for so small a matrix
    LAPACK would wake its threads.
    """
    m, n = shares.shape
    left = np.full(m, 1 / math.sqrt(m))
    right = np.empty(n)
    for _ in range(ROUNDS):
        right[:] = 0.0
        length = change = 0.0
        for i in range(m):
            for j in range(n):
                right[j] += left[i] * shares[i, j]
        for j in range(n):
            length += right[j] * right[j]
        right /= math.sqrt(length)
        length = 0.0
        new_left = np.zeros(m)
        for i in range(m):
            for j in range(n):
                new_left[i] += shares[i, j] * right[j]
            length += new_left[i] * new_left[i]
        new_left /= math.sqrt(length)
        for i in range(m):
            change = max(change, abs(new_left[i] - left[i]))
        left = new_left
        if change < CLOSE:
            break
    return left, right
