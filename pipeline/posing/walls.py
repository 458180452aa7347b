"""Walls from above: scan matching of a query's walls with those of a training submap.

Each training submap becomes a chart: cells of a wall, cells beside one, cells that its sensor saw
through, unknown ones. The query's walls are laid on it at all headings and offsets (scan matching,
Olson, ICRA 2009; METHODS 9.2): a wall on a wall counts for a place, a wall where the map saw
through counts against it, and one that was hidden from the map counts nothing.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Count, NotNegative, Positive, check
from pipeline.posing.ground import heights_m

Chart = NDArray[np.int8]
"""(2, cell, cell): WALL, BESIDE, SEEN_THROUGH or 0 where nothing is known, x along the first axis,
the robot in the middle; and the largest of the BLOCK × BLOCK cells from each on, by which the
search knows where it need not look."""
WALL = 2
BESIDE = 1
SEEN_THROUGH = -1
BLOCK = 4
PROMISING = 24
SECTORS = 180
"""Directions in which a first wall is looked for."""


@dataclass(frozen=True)
class Match:
    """The best way to lay a query on a chart."""

    score: float
    """Mean over the query's walls of 1 on a wall, .5 beside one, −.5 where the map saw through, 0
    where it knows nothing."""
    target_T_query: NDArray[np.float64]
    """(4, 4), a turn about z and a step in the plane."""


@dataclass(frozen=True)
class Walls:
    """How charts are drawn and searched."""

    low_m: float = 1.0
    """Points between these heights above the ground are walls: lower ones are cars and people."""
    high_m: float = 8.0
    cell_m: Positive = 1.0
    range_m: Positive = 40.0
    """Around the robot."""
    headings: Count = 120
    offset_m: Positive = 6.0
    """The query is sought this far from the training anchor, along x and y."""
    margin_m: NotNegative = 2.0
    """Seen through is what lies at least so much nearer to the sensor than the first wall."""

    def __post_init__(self) -> None:
        check(self, "walls")
        if not self.high_m > self.low_m:
            raise ConfigError(
                f"walls.high_m={self.high_m}: expected more than walls.low_m={self.low_m}"
            )

    @property
    def half(self) -> int:
        """Cells from a chart's middle to its border, beyond which no wall of a query comes."""
        return int(np.ceil(self.range_m / self.cell_m)) + self.reach + BLOCK

    @property
    def reach(self) -> int:
        """Offsets in cells to each side."""
        return int(np.ceil(self.offset_m / self.cell_m))

    def of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The points (n, 3) of walls within range, of points (m, 3), z up from the ground."""
        above_m = heights_m(points_m)
        near = np.hypot(points_m[:, 0], points_m[:, 1]) < self.range_m
        standing = (above_m > self.low_m) & (above_m < self.high_m)
        return np.ascontiguousarray(points_m[near & standing])

    def chart(self, walls_m: NDArray[np.float64], single: bool = True) -> Chart:
        """The chart of a submap's walls (n, 3).

        Only a `single` scan has a place from which it saw through.
        """
        margin_m = self.margin_m if single else np.inf
        chart: Chart = _chart(walls_m, self.cell_m, self.half, margin_m)
        return chart

    def turned(self, walls_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The cells (heading, n, 2) of a query's walls (m, 3), turned to each heading."""
        angles = np.arange(self.headings) * (2 * np.pi / self.headings)
        rotations = np.array(
            [[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]]
        ).transpose(2, 0, 1)
        return np.asarray(np.floor(self.middles(walls_m) @ rotations).astype(np.int64) + self.half)

    def middles(self, walls_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The middles (n, 2), in cells, of the cells that walls (m, 3) lie in."""
        cells = np.floor(walls_m[:, :2] / self.cell_m).astype(np.int64)
        _, first = np.unique(cell_numbers(cells), return_index=True)
        return np.asarray(cells[first] + 0.5, np.float64)

    def scores(
        self, chart: Chart, middles: NDArray[np.float64], heading: float
    ) -> NDArray[np.float64]:
        """How well walls, turned by a heading in radians, fit a chart at each offset.

        The walls are given by their `middles` (n, 2). Scores (offset, offset) as of a Match, along
        x, then y; offsets are −reach … reach cells.
        """
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        cells = np.floor(middles @ turn).astype(np.int64) + self.half
        return np.asarray(_sums(chart[0], cells, self.reach) / (WALL * max(len(middles), 1)))

    def match(self, chart: Chart, turned: NDArray[np.int64]) -> Match:
        """The best heading and offset of a query (heading, n, 2) on a chart."""
        pose = np.eye(4)
        if not turned.shape[1]:
            return Match(0.0, pose)
        score, heading, x, y = _search(chart, turned, self.reach)
        angle = heading * 2 * np.pi / self.headings
        pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pose[:2, 3] = x * self.cell_m, y * self.cell_m
        return Match(score / (WALL * turned.shape[1]), pose)


def cell_numbers(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number (n,) for each cell (n, 2), rising by row: `np.unique` is slow on pairs."""
    if not len(cells):
        return np.empty(0, np.int64)
    rows, columns = (cells - cells.min(axis=0)).T
    return np.asarray(rows * (columns.max() + 1) + columns)


@njit(cache=True, nogil=True, error_model="numpy")
def _chart(walls, cell_m, half, margin_m):  # type: ignore[no-untyped-def]
    """The chart of walls (n, 3); `margin_m` is infinite where nothing is seen through."""
    width = 2 * half
    first = np.full(SECTORS, np.inf)
    layers = np.zeros((2, width, width), np.int8)
    chart, largest = layers
    for i in range(len(walls)):
        sector = _sector(walls[i, 0], walls[i, 1])
        first[sector] = min(first[sector], np.hypot(walls[i, 0], walls[i, 1]))
    for x in range(width):
        for y in range(width):
            east = (x - half + 0.5) * cell_m
            north = (y - half + 0.5) * cell_m
            sector = _sector(east, north)
            nearest = min(first[sector - 1], first[sector], first[(sector + 1) % SECTORS])
            if np.isfinite(nearest) and np.hypot(east, north) < nearest - margin_m:
                chart[x, y] = SEEN_THROUGH
    for value, beside in ((BESIDE, 1), (WALL, 0)):
        for i in range(len(walls)):
            x = int(np.floor(walls[i, 0] / cell_m)) + half
            y = int(np.floor(walls[i, 1] / cell_m)) + half
            for a in range(max(x - beside, 0), min(x + beside + 1, width)):
                for b in range(max(y - beside, 0), min(y + beside + 1, width)):
                    chart[a, b] = value
    for x in range(width):
        for y in range(width):
            largest[x, y] = chart[x : x + BLOCK, y : y + BLOCK].max()
    return layers


@njit(cache=True, nogil=True, error_model="numpy")
def _sector(x, y):  # type: ignore[no-untyped-def]
    return int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS) % SECTORS


@njit(cache=True, nogil=True, error_model="numpy")
def _sums(chart, cells, reach):  # type: ignore[no-untyped-def]
    """The sum of chart values under cells (n, 2) at each offset."""
    offsets = 2 * reach + 1
    sums = np.zeros((offsets, offsets), np.int32)
    for i in range(len(cells)):
        for a in range(offsets):
            for b in range(offsets):
                sums[a, b] += chart[cells[i, 0] - reach + a, cells[i, 1] - reach + b]
    return sums


@njit(cache=True, nogil=True, error_model="numpy")
def _search(charts, turned, reach):  # type: ignore[no-untyped-def]
    """The highest sum of chart values under cells (heading, n, 2), and at which heading and offset.

    The largest values bound the sums of a block of offsets: only the PROMISING blocks of the
    highest bounds are summed.
    """
    chart, largest = charts
    blocks = -(-(2 * reach + 1) // BLOCK)
    offsets = 2 * reach + 1
    bounds = np.zeros((len(turned), blocks, blocks), np.int32)
    for heading in range(len(turned)):
        for i in range(turned.shape[1]):
            x = turned[heading, i, 0] - reach
            y = turned[heading, i, 1] - reach
            for a in range(blocks):
                for b in range(blocks):
                    bounds[heading, a, b] += largest[x + a * BLOCK, y + b * BLOCK]
    best = -(2**31)
    at_heading = 0
    at_x = 0
    at_y = 0
    sums = np.empty((BLOCK, BLOCK), np.int32)
    for block in np.argsort(-bounds.ravel(), kind="mergesort")[:PROMISING]:
        heading = block // blocks**2
        first_x = block // blocks % blocks * BLOCK
        first_y = block % blocks * BLOCK
        if bounds[heading, first_x // BLOCK, first_y // BLOCK] <= best:
            break
        sums[:] = 0
        for i in range(turned.shape[1]):
            x = turned[heading, i, 0] - reach + first_x
            y = turned[heading, i, 1] - reach + first_y
            for a in range(BLOCK):
                for b in range(BLOCK):
                    sums[a, b] += chart[x + a, y + b]
        for a in range(min(BLOCK, offsets - first_x)):
            for b in range(min(BLOCK, offsets - first_y)):
                if sums[a, b] > best:
                    best = sums[a, b]
                    at_heading = heading
                    at_x = first_x + a - reach
                    at_y = first_y + b - reach
    return best, at_heading, at_x, at_y
