"""Sparse storage of the dynamic octree (METHODS 4): the known leaves of a cube that moves along.

Leaves are stored in bricks of 8³. A brick is allocated when a ray touches it, and freed when all
its leaves are unknown again. A table over the whole cube tells where the leaves of each brick are.

The cube lies on a torus: a leaf's place follows from its whole-numbered coordinates in odometry,
modulo the side of the torus. So nothing moves in memory when the cube does; a leaf that enters the
cube takes the place of a leaf that left it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

BITS = 3
"""Bits of a leaf's coordinate within its brick."""
BRICK = 1 << BITS
"""Leaves along an edge of a brick. Bricks of 16³ were no faster on KITTI's scans."""
LEAVES = 1 << 3 * BITS
"""Leaves of a brick."""
NO_BRICK = np.int32(-1)
"""Entry of the table where there is no brick."""
SPARE_FACTOR = 1.5
"""Capacity of new pools, relative to what is needed."""
IDLE_FACTOR = 4.0
"""Pools are made smaller once their capacity is more than this many times what is needed."""


class Bricks(NamedTuple):
    """Pools of bricks, of which the first `used[0]` are in use.

    The leaves of all other bricks are unknown and unmarked. A leaf's key is a whole number: its
    upper bits number the brick's place on the torus, its lower bits the leaf in the brick, both
    x-major.
    """

    levels: int
    """There are 2^levels leaves around each axis of the torus."""
    table: NDArray[np.int32]
    """(place,) where the leaves of each place's brick begin in the pools, or NO_BRICK."""
    places: NDArray[np.int32]
    """(capacity,) the place of each brick on the torus."""
    log_odds: NDArray[np.float32]
    """(capacity · LEAVES,) the log-odds of the leaves; 0 is unknown."""
    marks: NDArray[np.uint8]
    """(capacity · LEAVES,) what the rays of the current scan did to each leaf
    (`octree_kernels`)."""
    used: NDArray[np.int64]
    """(1,) the number of bricks in use; an array, so that compiled functions can change it."""

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays, including their spare capacity."""
        return sum(array.nbytes for array in (self.table, self.places, self.log_odds, self.marks))


def empty(side: int) -> Bricks:
    """Bricks of which none is in use, for a cube of `side` leaves, a power of two."""
    levels = max(side.bit_length() - 1, BITS)
    table = np.full(8 ** (levels - BITS), NO_BRICK)
    return Bricks(
        levels,
        table,
        places=np.empty(0, np.int32),
        log_odds=np.empty(0, np.float32),
        marks=np.empty(0, np.uint8),
        used=np.zeros(1, np.int64),
    )


def with_room(bricks: Bricks, extra: int) -> Bricks:
    """The same bricks with room for `extra` more, with new pools if necessary."""
    n_used = int(bricks.used[0])
    if n_used + extra <= len(bricks.places) <= IDLE_FACTOR * (n_used + extra):
        return bricks
    capacity = int(SPARE_FACTOR * (n_used + extra))
    places = np.zeros(capacity, np.int32)
    log_odds = np.zeros(capacity * LEAVES, np.float32)
    marks = np.zeros(capacity * LEAVES, np.uint8)
    places[:n_used] = bricks.places[:n_used]
    log_odds[: n_used * LEAVES] = bricks.log_odds[: n_used * LEAVES]
    marks[: n_used * LEAVES] = bricks.marks[: n_used * LEAVES]
    return bricks._replace(places=places, log_odds=log_odds, marks=marks)


def bricks_of_a_ray(bricks: Bricks) -> int:
    """The largest number of bricks that a ray within the cube touches, that of its end included."""
    bricks_per_axis = 1 << (bricks.levels - BITS)
    # A ray crosses at most `bricks_per_axis` borders of bricks on each axis, and begins in one more
    # brick; its end may be in another brick. The torus has no more than bricks_per_axis³ bricks.
    return min(3 * bricks_per_axis + 2, bricks_per_axis**3)


def dense(bricks: Bricks, lowest_leaf: NDArray[np.int64], side: int) -> NDArray[np.float32]:
    """Log-odds (side, side, side), x-major, of the cube whose lowest leaf is `lowest_leaf` (3,).

    The lowest leaf is counted from the origin of odometry.
    """
    n_used = int(bricks.used[0])
    bricks_per_axis = 1 << (bricks.levels - BITS)
    # (brick x, brick y, brick z, leaf x, leaf y, leaf z), then the two axes of each kind together
    torus = np.zeros((bricks_per_axis,) * 3 + (BRICK,) * 3, np.float32)
    torus.reshape(-1, LEAVES)[bricks.places[:n_used]] = bricks.log_odds.reshape(-1, LEAVES)[:n_used]
    leaves = torus.transpose(0, 3, 1, 4, 2, 5).reshape((bricks_per_axis * BRICK,) * 3)
    return np.roll(leaves, -lowest_leaf, (0, 1, 2))[:side, :side, :side]


@njit(inline="always", error_model="numpy")
def part_of_key(coordinate, axis, levels):  # type: ignore[no-untyped-def]
    """The bits of a leaf's key that its `coordinate` on one axis (0, 1 or 2) sets.

    A leaf's key is the three parts of its axes, joined by OR.
    """
    # The last axis, z, has the lowest bits, both of the brick's place and of the leaf in the brick.
    place = (coordinate >> BITS) & ((1 << (levels - BITS)) - 1)
    return (place << (3 * BITS + (2 - axis) * (levels - BITS))) | (
        (coordinate & (BRICK - 1)) << ((2 - axis) * BITS)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def corner(bricks, brick):  # type: ignore[no-untyped-def]
    """Coordinates x, y, z on the torus of the lowest leaf of brick number `brick`."""
    bits = bricks.levels - BITS  # of the place on each axis, x highest
    place = np.int64(bricks.places[brick])
    mask = (1 << bits) - 1
    return (place >> 2 * bits) << BITS, ((place >> bits) & mask) << BITS, (place & mask) << BITS


@njit(cache=True, nogil=True, error_model="numpy")
def allocate(bricks, place):  # type: ignore[no-untyped-def]
    """Allocate a brick at a place of the torus that has none; returns where its leaves begin.

    The pools must have room for it.
    """
    brick = bricks.used[0]
    bricks.used[0] = brick + 1
    bricks.places[brick] = place
    bricks.table[place] = brick * LEAVES
    return bricks.table[place]


@njit(cache=True, nogil=True, error_model="numpy")
def free(bricks: Bricks, brick: int) -> None:
    """Free a brick whose leaves are all unknown; the last brick in use moves to its position.

    No leaf of either may be marked.
    """
    table = bricks.table
    places = bricks.places
    log_odds = bricks.log_odds
    used = bricks.used
    used[0] -= 1
    last_brick = used[0]
    table[places[brick]] = NO_BRICK
    if brick != last_brick:
        table[places[last_brick]] = brick * LEAVES
        places[brick] = places[last_brick]
        for leaf in range(LEAVES):
            log_odds[brick * LEAVES + leaf] = log_odds[last_brick * LEAVES + leaf]
            log_odds[last_brick * LEAVES + leaf] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def forget(bricks: Bricks, is_gone: NDArray[np.bool_]) -> None:
    """Make all leaves unknown whose coordinate on any axis `is_gone` (3, side of the torus)."""
    for brick in range(bricks.used[0]):
        x, y, z = corner(bricks, brick)
        if (
            is_gone[0, x : x + BRICK].any()
            or is_gone[1, y : y + BRICK].any()
            or is_gone[2, z : z + BRICK].any()
        ):
            for leaf in range(LEAVES):
                i = leaf >> 2 * BITS
                j = (leaf >> BITS) & (BRICK - 1)
                k = leaf & (BRICK - 1)
                if is_gone[0, x + i] or is_gone[1, y + j] or is_gone[2, z + k]:
                    bricks.log_odds[brick * LEAVES + leaf] = 0
