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


def threshold_for(precision: float, novelty: NDArray[np.float64], right: NDArray[np.bool_], weight: NDArray[np.float64]) -> float:
    """The largest novelty threshold that keeps the wanted precision among what it accepts; 0 where none does.

    A query (n,) is accepted below the threshold, and then is `right` or a false alarm; `weight` (n,) says how many real
    queries each stands for.
    """
    order = np.argsort(novelty, kind="stable")
    ordered = novelty[order]
    hits = np.cumsum((weight * right)[order])
    kept = hits / np.cumsum(weight[order]) >= precision
    last = np.append(ordered[1:] > ordered[:-1], True)
    good = np.flatnonzero(kept & last)
    return float(np.nextafter(ordered[good[-1]], np.inf)) if len(good) else 0.0
