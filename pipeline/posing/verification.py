"""Verification: which of a query's walls the map has, and which it contradicts (METHODS 9.4)."""

import numpy as np

from pipeline.posing.registration import Cloud, Points
from pipeline.posing.walls import SEEN_THROUGH, Chart, Walls


def structure(points_m: Points, target: Cloud, chart: Chart, walls: Walls, inlier_m: float) -> float:
    """The share of a query's walls that a training submap has, among those that it has or contradicts; 0 of none.

    `points_m` (n, 3) are the query's voxels in the submap's frame. A wall where the submap's sensor saw through is
    contradicted; one that was hidden from it says nothing.
    """
    standing_m = points_m[(points_m[:, 2] > walls.low_m) & (points_m[:, 2] < walls.high_m)]
    _, away_m = target.nearest(standing_m)
    cells = np.floor(standing_m[:, :2] / walls.cell_m).astype(np.int64) + walls.half
    inside = ((cells >= 0) & (cells < chart.shape[1])).all(axis=1)
    against = np.zeros(len(standing_m), bool)
    against[inside] = chart[0][tuple(cells[inside].T)] == SEEN_THROUGH
    has = away_m < inlier_m
    counted = has | against
    return float(has[counted].mean()) if counted.any() else 0.0
