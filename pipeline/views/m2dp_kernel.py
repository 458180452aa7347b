"""The hot loops of M2DP (`views.m2dp`): a cloud's moments, the bin of every point on every plane,
and the first singular vectors of the counts.

With 16 sectors, a point's sector follows from the signs of its two coordinates on the plane and
from one slope, its circle from the fourth root of r², since radii grow as squares. Both are found
in float32, which the compiler turns into SIMD. For points so near to the border of a bin that
float32 may err, the bin is found again in float64, so that bins are exact at every border. All
planes look at one block of points while it lies in the L1 cache. Counts go to four separate tables:
successive points often share a bin, and in one table each would wait for the previous write.
"""

import math

import numpy as np
from numba import njit, uint32

from pipeline.views.kernels import HALF, NAN_SAFE, ZERO

BLOCK = 256
"""Points handled at once, so that their intermediate results stay in the L1 cache."""
COPIES = 4
"""Number of separate tables of counts."""
QUICK = 16
"""The number of sectors that signs and a slope can distinguish. With any other number, all bins are
found in float64."""
GRAY = np.array([0, 1, 3, 2])
"""Sector within a quadrant, counted from the x axis, for each code of two bits. The upper bit is
set if the point is steeper than 45°, the lower one if it is more than 22.5° off the nearer axis."""
PLACE = np.argsort(np.concatenate([8 + GRAY, 15 - GRAY, 7 - GRAY, GRAY])).astype(np.uint32)
"""(QUICK,) the code of four bits under which each sector is counted: y is negative, x is negative,
then those of GRAY."""
SLOPE = np.float32(math.tan(math.pi / 8))
"""Slope at 22.5°."""
ERROR = np.float32(1e-6)
"""Bound on the error of a float32 coordinate or slope, in units of the largest distance."""
MAX_ROUNDS = 10_000
"""Largest number of rounds of the power iteration."""
SMALL_CHANGE = 1e-12
"""The power iteration ends once no number changes by as much as this."""


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, error_model="numpy")
def moments(points):  # type: ignore[no-untyped-def]
    """Mean (3,) in m of points (n, 3), scatter matrix (3, 3) in m², and largest distance in m.

    The scatter matrix and the distance are about the mean.
    """
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


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, boundscheck=False, error_model="numpy")
def bin_counts(  # type: ignore[no-untyped-def]
    points, mean, axes, farthest_m, planes, radii, angles, place
):
    """Count the points (n, 3) in each bin of each plane.

    Returns tables (plane, COPIES · circle · sector), whose COPIES are to be added up; sector s is
    counted at `place[s]`. `mean` (3,) and `farthest_m` come from `moments`. The columns of `axes`
    (3, 3) are the axes that the points are turned to, and `planes` (plane, 2, 3) are each plane's
    axes u and v in them. `radii` (circle + 1,) in metres and `angles` (sector + 1,) in radians are
    the borders of the bins.
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
    is_quick = sectors == QUICK
    unit = 1.0 / farthest_m
    n_circles = np.float32(circles)
    last_ring = np.int32(circles - 1)
    sector_count = np.int32(sectors)
    # Float32 is sure of a ring if the position is nearer to the ring's middle than this. The
    # position is circles · √r, of slope circles / (2 √r), which is at most circles² / 2 from the
    # border of the innermost circle on; so twice the error of r is allowed for.
    edge = HALF - ERROR * np.float32(circles * circles)
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        # 1. Move the block to its mean and axes, and scale it for float32.
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
            # 2. Find the bins on this plane in float32, and the points near a border.
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
                ids[i] = uint32(ring * sector_count + code)
                margin = min(min(low, high - low), abs(slope))
                is_near_border[i] = np.uint8((margin < ERROR) | (abs(ring_position - HALF) > edge))
            # 3. Find the bins of points near a border again in float64, or those of all points.
            near_border_count = np.int32(0)
            for i in range(m):
                near_border_count += np.int32(is_near_border[i])
            if near_border_count > 0 or not is_quick:
                for i in range(m):
                    if is_near_border[i] or not is_quick:
                        x = exact[i, 0]
                        y = exact[i, 1]
                        z = exact[i, 2]
                        u = planes[p, 0, 0] * x + planes[p, 0, 1] * y + planes[p, 0, 2] * z
                        v = planes[p, 1, 0] * x + planes[p, 1, 1] * y + planes[p, 1, 2] * z
                        ids[i] = _exact_bin(u, v, radii, angles, place)
            # 4. Count the points of each bin; point i goes to table i mod 4.
            whole_fours = m & ~3
            for i in range(0, whole_fours, COPIES):
                for copy in range(COPIES):
                    table[ids[i + copy] + uint32(copy) * stride] += uint32(1)
            for i in range(whole_fours, m):
                table[ids[i]] += uint32(1)
    return tables


@njit(cache=True, nogil=True, fastmath=NAN_SAFE, error_model="numpy")
def first_singular_vectors(shares):  # type: ignore[no-untyped-def]
    """The first left (m,) and right (n,) singular vector of a non-negative matrix (m, n).

    They have no negative entries either (Perron and Frobenius), and power iteration from a positive
    vector finds them. LAPACK is not used, since it would wake its threads for so small a matrix.
    """
    m, n = shares.shape
    left = np.full(m, 1 / math.sqrt(m))
    right = np.empty(n)
    for _ in range(MAX_ROUNDS):
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
        if change < SMALL_CHANGE:
            break
    return left, right


# Without fastmath=False the caller's fast-math would apply.
@njit(cache=True, nogil=True, fastmath=False, error_model="numpy")
def _exact_bin(u, v, radii, angles, place):  # type: ignore[no-untyped-def]
    """The number of the bin of (u, v), in metres on a plane, found in float64 (METHODS 3.1).

    A border belongs to the bin above it, and the last bin takes what lies beyond.
    """
    rho = math.sqrt(u * u + v * v)
    theta = math.atan2(v + 0.0, u + 0.0)  # no negative zero
    ring = len(radii) - 2
    sector = len(angles) - 2
    while ring > 0 and rho < radii[ring]:
        ring -= 1
    while sector > 0 and theta < angles[sector]:
        sector -= 1
    return uint32(ring * len(place) + place[sector])
