"""Held-out blocks of the training sequence: what epochs and thresholds are chosen on, never a test sequence."""

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses


def blocks(world_T_anchor: Poses, places: NDArray[np.int64], every_m: float, length_m: float) -> NDArray[np.bool_]:
    """Which submaps (n,) to hold out: a block of `length_m` in every `every_m` of path.

    A submap stays in training if its place would otherwise lose its last one.
    """
    steps = np.linalg.norm(np.diff(world_T_anchor[:, :3, 3], axis=0), axis=1)
    path_m = np.concatenate([[0.0], np.cumsum(steps)])
    held = (path_m + every_m / 2) % every_m < length_m
    trained = np.bincount(places[~held], minlength=int(places.max()) + 1)
    return held & (trained[places] > 0)
