"""Charts of walls: what a sensor saw of the walls around it, drawn from above (METHODS 9.2).

In: the points of a scan or of a submap. Out: a `Chart`, whose cells are a wall, beside a wall, seen
through by the sensor, or unknown.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.mapping.heights import heights_m

Chart = NDArray[np.int8]
"""(2, cell, cell) two layers; x along the first axis of cells, the robot in the middle.

Layer 0 has the cells: each is WALL, BESIDE, SEEN_THROUGH, or 0 if it is unknown. Layer 1 has at
each cell the maximum of the BLOCK × BLOCK cells that start there: an upper bound for the search."""
WALL = 2
BESIDE = 1
SEEN_THROUGH = -1
BLOCK = 4
"""Offsets along each side of a block, which share one bound."""
SECTORS = 180
"""Number of directions in which the first wall is searched for."""


def wall_points(
    points_m: NDArray[np.float64], low_m: float, high_m: float, range_m: float
) -> NDArray[np.float64]:
    """The points (n, 3) of walls: `low_m` to `high_m` above the ground, nearer than `range_m`.

    The points (m, 3) are in metres, z up from the ground.
    """
    above_m = heights_m(points_m)
    is_in_range = np.hypot(points_m[:, 0], points_m[:, 1]) < range_m
    is_wall = (above_m > low_m) & (above_m < high_m)
    return np.ascontiguousarray(points_m[is_in_range & is_wall])


def wall_chart(
    walls_m: NDArray[np.float64], cell_m: float, half_width_cells: int, margin_m: float
) -> Chart:
    """The chart of wall points (n, 3), of 2 `half_width_cells` to a side, the robot in the middle.

    A cell is seen through if it is nearer than the first wall in its direction by `margin_m`; an
    infinite `margin_m` marks no cell.
    """
    chart: Chart = _chart(walls_m, cell_m, half_width_cells, margin_m)
    return chart


def bounded(cells: NDArray[np.int8], border: int) -> Chart:
    """The chart of cells (x, y), from which a `border` on each side is cut off at last."""
    maxima = cells.copy()
    for x in range(BLOCK):
        for y in range(BLOCK):
            part = cells[x:, y:]
            np.maximum(
                maxima[: len(part), : part.shape[1]], part, out=maxima[: len(part), : part.shape[1]]
            )
    inner = slice(border, -border)
    return np.stack([cells[inner, inner], maxima[inner, inner]])


@njit(cache=True, nogil=True, error_model="numpy")
def _chart(walls, cell_m, half_width_cells, margin_m):  # type: ignore[no-untyped-def]
    """The chart of walls (n, 3); an infinite `margin_m` marks no cell as seen through."""
    width = 2 * half_width_cells
    first_wall_m = np.full(SECTORS, np.inf)
    layers = np.zeros((2, width, width), np.int8)
    chart, block_maxima = layers
    # The distance of the first wall in each direction.
    for i in range(len(walls)):
        sector = _sector(walls[i, 0], walls[i, 1])
        wall_m = np.hypot(walls[i, 0], walls[i, 1])
        first_wall_m[sector] = min(first_wall_m[sector], wall_m)
    # Cells well before the first wall are seen through.
    for x in range(width):
        for y in range(width):
            x_m = (x - half_width_cells + 0.5) * cell_m
            y_m = (y - half_width_cells + 0.5) * cell_m
            sector = _sector(x_m, y_m)
            # A cell may lie in two directions, so those beside its own count too.
            nearest_m = min(
                first_wall_m[sector - 1],
                first_wall_m[sector],
                first_wall_m[(sector + 1) % SECTORS],
            )
            if np.isfinite(nearest_m) and np.hypot(x_m, y_m) < nearest_m - margin_m:
                chart[x, y] = SEEN_THROUGH
    # Cells beside walls, then walls on top.
    for value, reach in ((BESIDE, 1), (WALL, 0)):
        for i in range(len(walls)):
            x = int(np.floor(walls[i, 0] / cell_m)) + half_width_cells
            y = int(np.floor(walls[i, 1] / cell_m)) + half_width_cells
            for a in range(max(x - reach, 0), min(x + reach + 1, width)):
                for b in range(max(y - reach, 0), min(y + reach + 1, width)):
                    chart[a, b] = value
    # The bounds.
    for x in range(width):
        for y in range(width):
            block_maxima[x, y] = chart[x : x + BLOCK, y : y + BLOCK].max()
    return layers


@njit(cache=True, nogil=True, error_model="numpy")
def _sector(x, y):  # type: ignore[no-untyped-def]
    """The direction of a point, of SECTORS."""
    return int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS) % SECTORS
