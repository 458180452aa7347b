"""Verification: which walls a query and a submap share, and which they contradict (METHODS 9.4)."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.posing.registration import Cloud, Points, moved
from pipeline.posing.walls import SEEN_THROUGH, Chart, Walls, cell_numbers


@dataclass(frozen=True)
class Agreement:
    """How a query that is laid on a training submap agrees with it: shares from 0 to 1.

    Of what stands alone, for ground lies on ground wherever a query is laid; and each column of
    wall voxels counts once, for a long wall shall not outvote the trees that tell it from its
    neighbours.
    """

    overlap: float
    """Of the query's wall voxels those that the submap has, and the other way round; their mean."""
    structure: float
    """Of the query's wall voxels that the submap has or contradicts: those that it has; 0 of none.

    A wall where the submap's sensor saw through is contradicted; one that was hidden from it says
    nothing.
    """
    seen_again: float
    """Of the submap's wall voxels that the query has or contradicts: those that it has; 0 of
    none."""

    @property
    def product(self) -> float:
        """The product of the three shares, by which poses of one query are compared."""
        return self.overlap * self.structure * self.seen_again


@dataclass(frozen=True)
class Seen:
    """What a sensor met, and what it saw through."""

    cloud: Cloud
    chart: Chart
    standing_m: Points
    """Wall points (n, 3) of the cloud's sample, within range."""

    @classmethod
    def of(cls, walls: Walls, cloud: Cloud, chart: Chart) -> Self:
        """Build it from a cloud and its chart."""
        return cls(cloud, chart, walls.of(cloud.sample_m))


def agreement(
    walls: Walls, inlier_m: float, target: Seen, query: Seen, target_T_query: Points
) -> Agreement:
    """How the query, at a pose (4, 4) in the target's frame, agrees with it.

    A voxel is had by one nearer than `inlier_m`.
    """
    there_m = moved(target_T_query, query.standing_m)
    back_m = moved(np.asarray(np.linalg.inv(target_T_query)), target.standing_m)
    back_m = back_m[np.hypot(back_m[:, 0], back_m[:, 1]) < walls.range_m]
    in_target, structure = _shares(walls, inlier_m, target, there_m)
    in_query, seen_again = _shares(walls, inlier_m, query, back_m)
    return Agreement((in_target + in_query) / 2, structure, seen_again)


def _shares(walls: Walls, inlier_m: float, seen: Seen, points_m: Points) -> tuple[float, float]:
    """The share of wall points (n, 3) that a sensor met: of all, then of those met or seen through.

    The points are in the frame of what was seen.
    """
    if not len(points_m):
        return 0.0, 0.0
    _, away_m = seen.cloud.nearest(points_m)
    matched = away_m < inlier_m
    cells = np.floor(points_m[:, :2] / walls.cell_m).astype(np.int64) + walls.half_width_cells
    inside = ((cells >= 0) & (cells < seen.chart.shape[1])).all(axis=1)
    contradicted = np.zeros(len(points_m), bool)
    contradicted[inside] = seen.chart[0][tuple(cells[inside].T)] == SEEN_THROUGH
    weight = _per_column(cells)
    counted = matched | contradicted
    shared = float(weight[matched].sum() / weight[counted].sum()) if counted.any() else 0.0
    return float(weight[matched].sum() / weight.sum()), shared


def _per_column(cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """The weight (n,) of points in cells (n, 2): each column of a cell counts 1 in all."""
    _, column, count = np.unique(cell_numbers(cells), return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[column])
