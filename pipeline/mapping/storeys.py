"""Finds floors above each other in a 3-D map, which from above look like one.

1. A level of a column is walkable if it has points, and none in the headroom above it.
2. A layer is a level at which most columns of a cell are walkable.
3. Two layers are storeys if many columns of the cell have both, far enough apart, and if something
   stands on the upper one or lies over it: nothing does over a ceiling or a roof.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.local_ground import CELL_M, COLUMN_M, LocalGround
from pipeline.mapping.tiled_map import TILE_M

LEVEL_M = 0.4
"""Height of a level."""
LOWEST_M = -2.0
HIGHEST_M = 30.0
"""Heights above the ground between which floors are searched for."""
APART_LEVELS = 6
"""Floors are at least so many levels (2.4 m) apart."""
HEADROOM_LEVELS = 4
"""A floor has no points in so many levels above its own two."""
OVER_LEVELS = 12
"""Walls that stand on a floor, or its ceiling, have points within so many levels above it."""
LAYER_SHARE = 0.35
"""A layer is walkable in this share of the columns with points."""
BOTH_SHARE = 0.25
"""This share of the columns has both of two storeys."""
OVER_SHARE = 0.05
"""This share of the columns has points over the upper storey."""
FEWEST_COLUMNS = 20
"""A cell of fewer columns with points is not looked at."""


class Storeys(NamedTuple):
    """Where a map has floors above each other."""

    cells: int
    """Number of cells of CELL_M that were looked at."""
    above: int
    """Number of those with a floor above another."""
    apart_m: float
    """The median of the heights of one floor above the next; NaN if there is none."""


def storeys(tiles_m: Iterable[NDArray[np.float64]], ground: LocalGround) -> Storeys:
    """Find the storeys of a map's tiles (n, 3), in metres."""
    cells = 0
    apart_levels: list[int] = []
    for points_m in tiles_m:
        tile_cells, tile_apart_levels = _of_tile(points_m, ground)
        cells += tile_cells
        apart_levels += tile_apart_levels
    apart_m = LEVEL_M * float(np.median(apart_levels)) if apart_levels else np.nan
    return Storeys(cells, len(apart_levels), apart_m)


def _of_tile(points_m: NDArray[np.float64], ground: LocalGround) -> tuple[int, list[int]]:
    """The number of cells of a tile, and by how many levels the storeys are apart in some."""
    above_m = points_m[:, 2] - ground.heights_m(points_m[:, :2])
    is_near = (above_m >= LOWEST_M) & (above_m < HIGHEST_M)
    points_m = points_m[is_near]
    if not len(points_m):
        return 0, []
    corner_m = np.floor(points_m[0, :2] / TILE_M) * TILE_M
    side = round(TILE_M / COLUMN_M)
    columns = np.floor((points_m[:, :2] - corner_m) / COLUMN_M).astype(np.int64).clip(0, side - 1)
    levels = np.floor((above_m[is_near] - LOWEST_M) / LEVEL_M).astype(np.int64)
    padding = OVER_LEVELS + 2
    occupied = np.zeros((side, side, round((HIGHEST_M - LOWEST_M) / LEVEL_M) + padding), bool)
    occupied[columns[:, 0], columns[:, 1], levels] = True
    walkable, is_over = _walkable(occupied)
    counts = _by_cell(np.asarray(occupied.any(axis=2, keepdims=True)))[..., 0]
    is_cell = counts >= FEWEST_COLUMNS
    needed = np.where(is_cell, LAYER_SHARE * counts, np.inf)
    is_layer = _by_cell(walkable) >= needed[..., None]
    has_over = _by_cell(is_over) >= OVER_SHARE * counts[..., None]
    apart = []
    for cell in np.argwhere(is_layer.sum(axis=2) > 1):
        layers = np.flatnonzero(is_layer[tuple(cell)])
        first = cell * round(CELL_M / COLUMN_M)
        part = walkable[tuple(slice(start, start + round(CELL_M / COLUMN_M)) for start in first)]
        if found := _apart(part, layers, has_over[tuple(cell)], BOTH_SHARE * counts[tuple(cell)]):
            apart.append(found)
    return int(is_cell.sum()), apart


def _walkable(occupied: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where columns (x, y, level) are walkable, a floor being two levels; and where they have
    points over such a floor."""
    count = occupied.shape[2] - OVER_LEVELS - 1
    floor = occupied[..., :count] | occupied[..., 1 : count + 1]
    head = [occupied[..., step : count + step] for step in range(2, 2 + HEADROOM_LEVELS)]
    over = [occupied[..., step : count + step] for step in range(2, 2 + OVER_LEVELS)]
    is_free = ~np.logical_or.reduce(head)
    return floor & is_free, np.asarray(np.logical_or.reduce(over), bool)


def _by_cell(columns: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The number of columns (x, y, level) that are true, by cell."""
    side = round(CELL_M / COLUMN_M)
    count = len(columns) // side
    cells = columns.reshape(count, side, count, side, -1)
    return np.asarray(cells.sum(axis=(1, 3)))


def _apart(
    walkable: NDArray[np.bool_],
    layers: NDArray[np.int64],
    has_over: NDArray[np.bool_],
    fewest_columns: float,
) -> int:
    """By how many levels the lowest two storeys of a cell are apart; 0 if it has only one."""
    for low in layers:
        for high in layers[layers >= low + APART_LEVELS]:
            both = walkable[..., low] & walkable[..., high]
            if has_over[high] and both.sum() >= fewest_columns:
                return int(high - low)
    return 0
