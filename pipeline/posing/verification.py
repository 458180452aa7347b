"""Verification: which walls a query and a submap share, and which they contradict (METHODS 9.4).

In: a query and a training submap, each with the points that its sensor hit and the space that it
saw through, and the query's pose in the submap's frame. Out: an `Agreement`, shares of their walls,
by which a `ScanFix` compares poses.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import transformed
from pipeline.mapping.wall_chart import SEEN_THROUGH, Chart
from pipeline.posing.registration import Cloud, Points
from pipeline.posing.walls import Walls, cell_numbers


@dataclass(frozen=True)
class Agreement:
    """How well a query at a pose agrees with a training submap: shares from 0 to 1.

    Only points of walls count, that is, of all objects well above the ground: ground fits ground at
    any pose. Each upright column of wall points counts once, so that a long high wall does not
    outvote the trees that distinguish it from other walls.

    A sensor contradicts a wall if it saw through the wall's position. A wall that was hidden from
    the sensor is neither shared nor contradicted.
    """

    overlap: float
    """The mean of two shares: of the query's walls that the submap has too, and of the submap's
    walls that the query has too."""
    structure: float
    """Share of the query's walls that the submap has, among those that it has or contradicts; 0 if
    there are none."""
    seen_again: float
    """Share of the submap's walls that the query has, among those that it has or contradicts; 0 if
    there are none."""

    @property
    def product(self) -> float:
        """The product of the three shares, by which poses of one query are compared."""
        return self.overlap * self.structure * self.seen_again


@dataclass(frozen=True)
class Seen:
    """What a sensor hit, and what it saw through."""

    cloud: Cloud
    """The points that the sensor hit."""
    chart: Chart
    """The cells, from above, that have walls or were seen through."""
    walls_m: Points
    """(n, 3) the points of walls within range, among a sample of the cloud."""

    @classmethod
    def of(cls, walls: Walls, cloud: Cloud, chart: Chart) -> Self:
        """What a sensor saw, from its cloud and chart."""
        return cls(cloud, chart, walls.of(cloud.sample_m))


def agreement(
    walls: Walls,
    inlier_m: float,
    target: Seen,
    query: Seen,
    target_T_query: NDArray[np.float64],
) -> Agreement:
    """How well the query, at a pose (4, 4) in the target's frame, agrees with the target.

    Either of them has a wall point of the other if it has a point nearer to it than `inlier_m`.
    """
    query_walls_m = transformed(target_T_query, query.walls_m)  # in the target's frame
    in_target, structure = _shares(walls, inlier_m, target, query_walls_m)
    target_walls_m = transformed(np.asarray(np.linalg.inv(target_T_query)), target.walls_m)
    is_in_range = np.hypot(target_walls_m[:, 0], target_walls_m[:, 1]) < walls.range_m
    in_query, seen_again = _shares(walls, inlier_m, query, target_walls_m[is_in_range])
    return Agreement((in_target + in_query) / 2, structure, seen_again)


def _shares(walls: Walls, inlier_m: float, seen: Seen, walls_m: Points) -> tuple[float, float]:
    """Two shares of wall points (n, 3), in a sensor's frame, that the sensor hit.

    The first is the share of all points, the second the share of the points that the sensor hit or
    contradicts, having seen through their positions.
    """
    if not len(walls_m):
        return 0.0, 0.0
    _, away_m = seen.cloud.nearest(walls_m)
    is_hit = away_m < inlier_m
    cells = np.floor(walls_m[:, :2] / walls.cell_m).astype(np.int64) + walls.half_width_cells
    is_inside = ((cells >= 0) & (cells < seen.chart.shape[1])).all(axis=1)
    is_contradicted = np.zeros(len(walls_m), bool)
    is_contradicted[is_inside] = seen.chart[0][tuple(cells[is_inside].T)] == SEEN_THROUGH
    is_decided = is_hit | is_contradicted
    weight = _column_weights(cells)
    hit_weight = weight[is_hit].sum()
    among_all = float(hit_weight / weight.sum())
    among_decided = float(hit_weight / weight[is_decided].sum()) if is_decided.any() else 0.0
    return among_all, among_decided


def _column_weights(cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """The weight (n,) of each point, by its cell (n, 2): the points of a cell add up to 1."""
    _, column, count = np.unique(cell_numbers(cells), return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[column])
