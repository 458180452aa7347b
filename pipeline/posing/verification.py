"""Verification: which walls a query and a training submap have in common, and which they contradict (METHODS 9.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.registration import Cloud, Points, moved
from pipeline.posing.walls import SEEN_THROUGH, Chart, Walls


@dataclass(frozen=True)
class Agreement:
    """How a query that is laid on a training submap agrees with it: shares from 0 to 1."""

    overlap: float
    """Of the query's voxels: those that the submap has."""
    structure: float
    """Of the query's wall voxels that the submap has or contradicts: those that it has; 0 of none.

    A wall where the submap's sensor saw through is contradicted; one that was hidden from it says nothing.
    """
    seen_again: float
    """Of the submap's wall voxels that the query has or contradicts: those that it has; 0 of none."""

    @property
    def product(self) -> float:
        """One number, by which poses of one query are compared."""
        return self.overlap * self.structure * self.seen_again


@dataclass(frozen=True)
class Seen:
    """A cloud and its chart: what its sensor met, and what it saw through."""

    cloud: Cloud
    chart: Chart
    standing: NDArray[np.bool_]
    """Which points of the cloud's sample are of walls (Walls.standing)."""


def agreement(walls: Walls, inlier_m: float, target: Seen, query: Seen, target_T_query: Points) -> Agreement:
    """How the query, at a pose (4, 4) in the target's frame, agrees with it; a voxel is had by one nearer than `inlier_m`."""
    query_m = moved(target_T_query, query.cloud.sample_m)
    _, away_m = target.cloud.nearest(query_m)
    near = away_m < inlier_m
    structure = _shared(walls, target.chart, query_m[query.standing], near[query.standing])
    query_T_target = np.asarray(np.linalg.inv(target_T_query))
    back_m = moved(query_T_target, target.cloud.sample_m[target.standing])
    back_m = back_m[np.hypot(back_m[:, 0], back_m[:, 1]) < walls.range_m]
    if not len(back_m):
        return Agreement(float(near.mean()), structure, 0.0)
    _, away_m = query.cloud.nearest(back_m)
    return Agreement(float(near.mean()), structure, _shared(walls, query.chart, back_m, away_m < inlier_m))


def _shared(walls: Walls, chart: Chart, points_m: Points, has: np.ndarray) -> float:
    """Of wall points (n, 3) in the frame of a chart that `has` (n,) them or saw through them, the share that it has."""
    cells = np.floor(points_m[:, :2] / walls.cell_m).astype(np.int64) + walls.half
    inside = ((cells >= 0) & (cells < chart.shape[1])).all(axis=1)
    against = np.zeros(len(points_m), bool)
    against[inside] = chart[0][tuple(cells[inside].T)] == SEEN_THROUGH
    counted = has | against
    return float(has[counted].mean()) if counted.any() else 0.0
