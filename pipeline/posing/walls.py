"""Walls from above: matches a query's walls with those of a training submap (METHODS 9.2).

In: the points of a query and of a training submap. Out: the heading and offset at which their walls
fit best, and how well. This is scan matching after Olson, ICRA 2009:

1. Choose the points of walls: those at some height above the ground.
2. Draw a submap's walls from above as a chart, whose cells are a wall, beside a wall, seen through
   by the sensor, or unknown.
3. Place the query's walls on the chart at many headings and offsets. A wall on a wall raises the
   score, a wall where the map saw through lowers it, and a wall that was hidden from the map does
   neither. An upper bound shows which offsets are worth computing.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Count, NotNegative, Positive, checked
from pipeline.mapping.wall_chart import BLOCK, WALL, Chart, wall_chart, wall_points

MOST_BLOCKS = 24
"""Largest number of blocks of offsets that are computed; more take longer and miss less."""


@dataclass(frozen=True)
class Match:
    """The pose at which a query fits a chart best."""

    score: float
    """Mean over the cells of the query's walls: 1 on a wall of the chart, .5 beside a wall, −.5
    where the map saw through, 0 where the chart is unknown."""
    target_T_query: NDArray[np.float64]
    """(4, 4) the pose: a turn about z and a step in the plane."""


@dataclass(frozen=True)
@checked("walls")
class Walls:
    """How charts are drawn and searched."""

    low_m: float = 1.0
    """Points between `low_m` and `high_m` above the ground are walls: lower points are of cars and
    people."""
    high_m: float = 8.0
    cell_m: Positive = 1.0
    """Side of a chart's cells."""
    range_m: Positive = 40.0
    """Walls farther from the robot than this are left out."""
    headings: Count = 120
    """Number of headings that are tried, evenly spaced around the circle."""
    offset_m: Positive = 6.0
    """Largest offset from the training anchor that is tried, along x and y."""
    margin_m: NotNegative = 2.0
    """A cell counts as seen through if it is nearer than the first wall in its direction by at
    least this."""

    def __post_init__(self) -> None:
        if not self.high_m > self.low_m:
            raise ConfigError(
                f"walls.high_m={self.high_m}: expected more than walls.low_m={self.low_m}"
            )

    @property
    def half_width_cells(self) -> int:
        """Cells from a chart's centre to its border; no wall of a shifted query lies beyond."""
        return int(np.ceil(self.range_m / self.cell_m)) + self.offset_cells + BLOCK

    @property
    def offset_cells(self) -> int:
        """Largest offset of a query to each side, in cells."""
        return int(np.ceil(self.offset_m / self.cell_m))

    def of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The points (n, 3) of walls within range, among points (m, 3), z up from the ground."""
        return wall_points(points_m, self.low_m, self.high_m, self.range_m)

    def chart(self, walls_m: NDArray[np.float64], single: bool = True) -> Chart:
        """The chart of a submap's walls (n, 3).

        Cells are marked as seen through only if the submap is a `single` scan, since several scans
        have no common viewpoint.
        """
        margin_m = self.margin_m if single else np.inf
        return wall_chart(walls_m, self.cell_m, self.half_width_cells, margin_m)

    def cells_at_headings(self, walls_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The cells (heading, n, 2) of a query's walls (m, 3), turned to each heading."""
        angles = np.arange(self.headings) * (2 * np.pi / self.headings)
        cells = np.floor(self.middles(walls_m) @ _transposed_rotation(angles)).astype(np.int64)
        return np.asarray(cells + self.half_width_cells)

    def middles(self, walls_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The centres (n, 2), in cells, of the cells with walls (m, 3); each cell once."""
        cells = np.floor(walls_m[:, :2] / self.cell_m).astype(np.int64)
        _, first = np.unique(cell_numbers(cells), return_index=True)
        return np.asarray(cells[first] + 0.5, np.float64)

    def scores(
        self, chart: Chart, middles: NDArray[np.float64], heading: float
    ) -> NDArray[np.float64]:
        """How well walls, turned by a heading in radians, fit a chart at each offset.

        The walls are given by their `middles` (n, 2). Returns the scores, defined as in `Match`,
        of shape (offset along x, offset along y), for offsets from −offset_cells to offset_cells.
        """
        cells = np.floor(middles @ _transposed_rotation(heading)).astype(np.int64)
        sums = _sums(chart[0], cells + self.half_width_cells, self.offset_cells)
        return np.asarray(sums / (WALL * max(len(middles), 1)))

    def match(
        self,
        chart: Chart,
        cells_at_headings: NDArray[np.int64],
        headings: NDArray[np.int64] | None = None,
    ) -> Match:
        """The heading and offset at which the cells of a query (heading, n, 2) fit a chart best.

        Only the headings of these numbers are tried, by default all. The search may stop early, and
        then miss a slightly better pose.
        """
        pose = np.eye(4)
        if not cells_at_headings.shape[1]:
            return Match(0.0, pose)
        if headings is not None:
            cells_at_headings = cells_at_headings[headings]
        score, heading, x, y = _search(chart, cells_at_headings, self.offset_cells)
        if headings is not None:
            heading = int(headings[heading])
        angle = heading * 2 * np.pi / self.headings
        pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pose[:2, 3] = x * self.cell_m, y * self.cell_m
        return Match(score / (WALL * cells_at_headings.shape[1]), pose)


def cell_numbers(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number (n,) for each cell (n, 2), increasing by row: `np.unique` is slow on pairs."""
    if not len(cells):
        return np.empty(0, np.int64)
    rows, columns = (cells - cells.min(axis=0)).T
    return np.asarray(rows * (columns.max() + 1) + columns)


def _transposed_rotation(angle_rad: NDArray[Any] | float) -> NDArray[Any]:
    """Rotations in the plane (…, 2, 2) by angles (…), transposed: row vectors turn as p @ R.T."""
    cosine = np.cos(angle_rad)
    sine = np.sin(angle_rad)
    return np.moveaxis(np.array([[cosine, sine], [-sine, cosine]]), (0, 1), (-2, -1))


@njit(cache=True, nogil=True, error_model="numpy")
def _sums(chart, cells, offset_cells):  # type: ignore[no-untyped-def]
    """The sum of chart values under cells (n, 2) at each offset."""
    offsets = 2 * offset_cells + 1
    sums = np.zeros((offsets, offsets), np.int32)
    for i in range(len(cells)):
        for a in range(offsets):
            for b in range(offsets):
                sums[a, b] += chart[cells[i, 0] - offset_cells + a, cells[i, 1] - offset_cells + b]
    return sums


@njit(cache=True, nogil=True, error_model="numpy")
def _search(charts, cells_at_headings, offset_cells):  # type: ignore[no-untyped-def]
    """Find the highest sum of chart values under cells (heading, n, 2), by branch and bound.

    Returns that sum, its heading (an index), and its offset along x and y in cells. The chart's
    second layer bounds the sums in a block of offsets. Blocks are computed in order of their
    bounds, until no bound exceeds the best sum, which is then the highest of all, or until
    MOST_BLOCKS blocks are computed; then a higher sum may be missed.
    """
    chart, block_maxima = charts
    offsets = 2 * offset_cells + 1
    blocks_per_side = -(-offsets // BLOCK)  # rounded up
    # The bound of each block at each heading.
    bounds = np.zeros((len(cells_at_headings), blocks_per_side, blocks_per_side), np.int32)
    for heading in range(len(cells_at_headings)):
        for i in range(cells_at_headings.shape[1]):
            x = cells_at_headings[heading, i, 0] - offset_cells
            y = cells_at_headings[heading, i, 1] - offset_cells
            for a in range(blocks_per_side):
                for b in range(blocks_per_side):
                    bounds[heading, a, b] += block_maxima[x + a * BLOCK, y + b * BLOCK]
    # The sums in the blocks of the highest bounds.
    best = -(2**31)  # below any sum
    best_heading = 0
    best_x = 0
    best_y = 0
    sums = np.empty((BLOCK, BLOCK), np.int32)
    for block in np.argsort(-bounds.ravel(), kind="mergesort")[:MOST_BLOCKS]:
        # The inverse of ravel: block = (heading * blocks_per_side + row) * blocks_per_side + column
        column = block % blocks_per_side
        row = block // blocks_per_side % blocks_per_side
        heading = block // blocks_per_side**2
        if bounds[heading, row, column] <= best:
            break
        first_x = row * BLOCK
        first_y = column * BLOCK
        sums[:] = 0
        for i in range(cells_at_headings.shape[1]):
            x = cells_at_headings[heading, i, 0] - offset_cells + first_x
            y = cells_at_headings[heading, i, 1] - offset_cells + first_y
            for a in range(BLOCK):
                for b in range(BLOCK):
                    sums[a, b] += chart[x + a, y + b]
        for a in range(min(BLOCK, offsets - first_x)):
            for b in range(min(BLOCK, offsets - first_y)):
                if sums[a, b] > best:
                    best = sums[a, b]
                    best_heading = heading
                    best_x = first_x + a - offset_cells
                    best_y = first_y + b - offset_cells
    return best, best_heading, best_x, best_y
