"""Validation blocks: stretches of the training path that are not learned.

Epochs, thresholds and settings are chosen on validation blocks, never on a test sequence.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, travelled_m


def blocks(
    world_T_anchor: Poses,
    places: NDArray[np.int64],
    every_m: float,
    length_m: float,
    later_m: float = 0.0,
) -> NDArray[np.bool_]:
    """True for the submaps (n,) in validation blocks: `length_m` in every `every_m` of the path.

    Blocks begin at `every_m` / 2 + `later_m` along the path, and every `every_m` before and after;
    a path may begin within a block. `later_m` shifts all blocks, so that several calls can cover
    every part of a path. A submap is not in a block if its place (n,) would have no submap left for
    training.
    """
    # The path since the last block began: modulo every_m, adding half of every_m is the same as
    # subtracting it.
    since_begin_m = (travelled_m(world_T_anchor[:, :3, 3]) + every_m / 2 - later_m) % every_m
    is_in_block = since_begin_m < length_m
    trained_count = np.bincount(places[~is_in_block], minlength=int(places.max()) + 1)
    return is_in_block & (trained_count[places] > 0)


def number_blocks(
    world_T_anchor: Poses, is_validation: NDArray[np.bool_], every_m: float, length_m: float
) -> NDArray[np.int64]:
    """The number (h,) of the block of each of the h validation submaps, from 0 along the path.

    A submap belongs to the next block if it is more than half of `every_m`, and more than
    `length_m`, behind the first submap of a block. That is longer than a block of `blocks`, and
    shorter than the path to the next block. A path that is all validation is cut into blocks of
    this length.
    """
    path_m = travelled_m(world_T_anchor[:, :3, 3])[is_validation]
    numbers = np.empty(len(path_m), np.int64)
    longest_m = max(every_m / 2, length_m)
    block = -1
    first_m = -np.inf
    for submap, submap_m in enumerate(path_m):
        if submap_m - first_m >= longest_m:
            block += 1
            first_m = submap_m
        numbers[submap] = block
    return numbers
