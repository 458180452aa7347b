"""The known leaves of a moving cube, in bricks of 8³ leaves allocated when touched.

The cube lies on a torus: where a leaf is stored follows from its whole-numbered coordinates in
odometry, modulo the side. So nothing moves in memory when the cube does: a leaf that enters it is
stored where one that left was.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

BITS = 3
BRICK = 1 << BITS
LEAVES = 1 << 3 * BITS
"""Leaves along an edge of a brick, and in one. Bricks of 16³ were no faster on KITTI's scans."""
NONE = np.int32(-1)
SPARE = 1.5
IDLE = 4.0
"""Capacity of new pools over what is needed, and where it has become too large."""


class Bricks(NamedTuple):
    """Pools of bricks, the first `used[0]` of them in use.

    The leaves of all others are unknown and unmarked. A leaf's key is the number of its brick's
    place on the torus, then its own in the brick, both x-major.
    """

    levels: int
    """There are 2^levels leaves around each axis of the torus."""
    table: NDArray[np.int32]
    """(places,) where the leaves of the brick at each place begin in the pools, or NONE."""
    places: NDArray[np.int32]
    """(capacity,) the place of each brick."""
    log_odds: NDArray[np.float32]
    """(capacity · LEAVES,) of the leaves; 0 is unknown."""
    marks: NDArray[np.uint8]
    """(capacity · LEAVES,) what the rays of a scan did to each."""
    used: NDArray[np.int64]
    """(1,)"""

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays, their spare capacity too."""
        return sum(array.nbytes for array in (self.table, self.places, self.log_odds, self.marks))


def empty(side: int) -> Bricks:
    """No bricks yet, on a torus for a cube of `side` leaves, a power of two."""
    levels = max(side.bit_length() - 1, BITS)
    table = np.full(8 ** (levels - BITS), NONE)
    return Bricks(
        levels,
        table,
        np.empty(0, np.int32),
        np.empty(0, np.float32),
        np.empty(0, np.uint8),
        np.zeros(1, np.int64),
    )


def with_room(bricks: Bricks, extra: int) -> Bricks:
    """The same bricks with room for `extra`: in new pools if these are too small or too large."""
    n_used = int(bricks.used[0])
    if n_used + extra <= len(bricks.places) <= IDLE * (n_used + extra):
        return bricks
    capacity = int(SPARE * (n_used + extra))
    places = np.zeros(capacity, np.int32)
    log_odds = np.zeros(capacity * LEAVES, np.float32)
    marks = np.zeros(capacity * LEAVES, np.uint8)
    places[:n_used] = bricks.places[:n_used]
    log_odds[: n_used * LEAVES] = bricks.log_odds[: n_used * LEAVES]
    marks[: n_used * LEAVES] = bricks.marks[: n_used * LEAVES]
    return bricks._replace(places=places, log_odds=log_odds, marks=marks)


def bricks_of_a_ray(bricks: Bricks) -> int:
    """How many bricks a ray within the cube touches at most, its end's too."""
    axis = 1 << (bricks.levels - BITS)
    return min(3 * axis + 2, axis**3)


def dense(bricks: Bricks, lowest: NDArray[np.int64], side: int) -> NDArray[np.float32]:
    """Log-odds (side, side, side), x-major, of the cube whose lowest leaf is `lowest` (3,)."""
    n_used = int(bricks.used[0])
    axis = 1 << (bricks.levels - BITS)
    torus = np.zeros((axis,) * 3 + (BRICK,) * 3, np.float32)
    torus.reshape(-1, LEAVES)[bricks.places[:n_used]] = bricks.log_odds.reshape(-1, LEAVES)[:n_used]
    leaves = torus.transpose(0, 3, 1, 4, 2, 5).reshape((axis * BRICK,) * 3)
    return np.roll(leaves, -lowest, (0, 1, 2))[:side, :side, :side]


@njit(inline="always", error_model="numpy")
def part_of_key(cell, axis, levels):  # type: ignore[no-untyped-def]
    """The bits of a leaf's key that its coordinate `cell` on an axis sets.

    A leaf's key has three such parts.
    """
    place = (cell >> BITS) & ((1 << (levels - BITS)) - 1)
    return (place << (3 * BITS + (2 - axis) * (levels - BITS))) | (
        (cell & (BRICK - 1)) << ((2 - axis) * BITS)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def corner(bricks, brick):  # type: ignore[no-untyped-def]
    """Coordinates on the torus of a brick's lowest leaf."""
    bits = bricks.levels - BITS
    place = np.int64(bricks.places[brick])
    mask = (1 << bits) - 1
    return (place >> 2 * bits) << BITS, ((place >> bits) & mask) << BITS, (place & mask) << BITS


@njit(cache=True, nogil=True, error_model="numpy")
def allocate(bricks, place):  # type: ignore[no-untyped-def]
    """Allocate a brick at a place that has none, and return where its leaves begin.

    There must be room for it.
    """
    brick = bricks.used[0]
    bricks.used[0] = brick + 1
    bricks.places[brick] = place
    bricks.table[place] = brick * LEAVES
    return bricks.table[place]


@njit(cache=True, nogil=True, error_model="numpy")
def free(bricks: Bricks, brick: int) -> None:
    """Give back a brick whose leaves are unknown; the last one in use moves to where it was.

    No leaf of either is marked.
    """
    table = bricks.table
    places = bricks.places
    log_odds = bricks.log_odds
    used = bricks.used
    used[0] -= 1
    last_brick = used[0]
    table[places[brick]] = NONE
    if brick != last_brick:
        table[places[last_brick]] = brick * LEAVES
        places[brick] = places[last_brick]
        for leaf in range(LEAVES):
            log_odds[brick * LEAVES + leaf] = log_odds[last_brick * LEAVES + leaf]
            log_odds[last_brick * LEAVES + leaf] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def forget(bricks: Bricks, is_gone: NDArray[np.bool_]) -> None:
    """Make the leaves unknown of which a coordinate on the torus `is_gone` (3, torus)."""
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
