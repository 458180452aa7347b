"""Held-out blocks of the training sequence: what epochs and thresholds are chosen on, never a test sequence."""

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses


def blocks(
    world_T_anchor: Poses, places: NDArray[np.int64], every_m: float, length_m: float, later_m: float = 0.0
) -> NDArray[np.bool_]:
    """Which submaps (n,) to hold out: a block of `length_m` in every `every_m` of path, all so much later.

    A submap stays in training if its place would otherwise lose its last one.
    """
    held = (_path_m(world_T_anchor) + every_m / 2 - later_m) % every_m < length_m
    trained = np.bincount(places[~held], minlength=int(places.max()) + 1)
    return held & (trained[places] > 0)


def block_of(world_T_anchor: Poses, every_m: float) -> NDArray[np.int64]:
    """The number (n,) of the stretch of `every_m` of path that each submap lies in, a block in the middle of each."""
    return ((_path_m(world_T_anchor) + every_m / 2) // every_m).astype(np.int64)


def _path_m(world_T_anchor: Poses) -> NDArray[np.float64]:
    """Driven up to each submap (n,)."""
    steps = np.linalg.norm(np.diff(world_T_anchor[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
