"""Held-out blocks of the training sequence, on which epochs and thresholds are chosen.

Never on a test sequence.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses


def blocks(
    world_T_anchor: Poses,
    places: NDArray[np.int64],
    every_m: float,
    length_m: float,
    later_m: float = 0.0,
) -> NDArray[np.bool_]:
    """Which submaps (n,) to hold out: a block of `length_m` in every `every_m` of path.

    All blocks lie `later_m` further on. A submap stays in training if its place would otherwise
    lose its last one.
    """
    is_held_out = (_path_m(world_T_anchor) + every_m / 2 - later_m) % every_m < length_m
    trained = np.bincount(places[~is_held_out], minlength=int(places.max()) + 1)
    return is_held_out & (trained[places] > 0)


def numbered(
    world_T_anchor: Poses, is_held_out: NDArray[np.bool_], every_m: float, length_m: float
) -> NDArray[np.int64]:
    """The block (h,) of each submap that is held out (n,), from 0 along the path.

    A block ends where half of `every_m` lies behind its first submap, or `length_m` if that is
    more: so do stretches of a path all of which is held out.
    """
    path_m = _path_m(world_T_anchor)[is_held_out]
    numbers = np.empty(len(path_m), np.int64)
    block = -1
    first_m = -np.inf
    for submap, at_m in enumerate(path_m):
        if at_m - first_m >= max(every_m / 2, length_m):
            block += 1
            first_m = at_m
        numbers[submap] = block
    return numbers


def _path_m(world_T_anchor: Poses) -> NDArray[np.float64]:
    """Metres (n,) along the path to each submap."""
    steps = np.linalg.norm(np.diff(world_T_anchor[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
