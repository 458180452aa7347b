"""Likelihood fields: prepares a level map for the search of poses.

In: a level map. Out: a `Field`, which holds for each cell the distance to the nearest wall, and
from it the likelihood that a beam ends there (Thrun, Burgard and Fox, Probabilistic Robotics,
section 6.4; METHODS 13.1). Its `Pyramid` holds maxima of the likelihood over ever larger squares
of cells. With these, search.py bounds the scores of many poses at once (Olson, Real-Time
Correlative Scan Matching, ICRA 2009).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from pipeline.level.level_map import LevelMap

CELL_M = 0.1
"""Smallest cell of a field, about: finer cells cost time and find no more poses."""
SIGMA_M = 0.2
"""Standard deviation of a hit's distance from its wall, in the search."""
UNKNOWN_SHARE = 0.15
"""The least likelihood of a hit in unknown space, where it contradicts nothing."""
STAND_M = 0.3
"""A robot stands in free space, or at most this far from it."""
FARTHEST_M = 2.0
"""Larger distances to a wall count as this."""
LEVELS = 3
"""The coarsest nodes of the search are 2**LEVELS cells wide."""
REACH_M = 30.0
"""Hits farther from the robot than this are left out."""


@dataclass(frozen=True)
class Field:
    """A level map prepared for the search, in its own grid: x along columns, y along rows."""

    cell_m: float
    distance_m: NDArray[np.float32]
    """(row, col) distance from the centre of each cell to that of the nearest wall, at most
    FARTHEST_M."""
    walls: NDArray[np.bool_]
    """(row, col) True where a cell is a wall."""
    free: NDArray[np.bool_]
    """(row, col) True where a cell is known to be free."""
    world_T_grid: NDArray[np.float64]
    """(4, 4) pose of the outer corner of cell (0, 0)."""

    @classmethod
    def of(cls, level_map: LevelMap) -> Self:
        """Prepare a map. If its cells are small, each square of them becomes one cell of the field.

        This cell is a wall if any of the cells is a wall, else free if any of them is free. Around
        the map it has FARTHEST_M of unknown cells: a hit beyond a wall at the map's edge is as far
        from it as one beyond any other wall.
        """
        merged_cells = max(1, round(CELL_M / level_map.cell_m))
        cell_m = level_map.cell_m * merged_cells
        edge = int(np.ceil(FARTHEST_M / cell_m))
        walls = np.pad(_merged(level_map.walls, merged_cells), edge)
        free = np.pad(_merged(level_map.free, merged_cells), edge) & ~walls
        map_T_grid = np.eye(4)
        map_T_grid[:2, 3] = -edge * cell_m
        distance_m = cell_m * distance_transform_edt(~walls)
        return cls(
            cell_m,
            np.minimum(distance_m, FARTHEST_M).astype(np.float32),
            walls,
            free,
            level_map.world_T_grid @ map_T_grid,
        )

    @cached_property
    def likelihood(self) -> NDArray[np.uint8]:
        """(row, col) the likelihood of a hit in each cell, in 255ths."""
        likelihood = np.exp(-(self.distance_m.astype(np.float64) ** 2) / (2 * SIGMA_M**2))
        unknown = ~self.free & ~self.walls
        likelihood[unknown] = np.maximum(likelihood[unknown], UNKNOWN_SHARE)
        return np.asarray(np.rint(255 * likelihood).astype(np.uint8))

    @cached_property
    def can_stand(self) -> NDArray[np.bool_]:
        """(row, col) True where a robot can stand."""
        reach = int(np.ceil(STAND_M / self.cell_m))
        y, x = np.ogrid[-reach : reach + 1, -reach : reach + 1]
        disc = x**2 + y**2 <= (STAND_M / self.cell_m) ** 2
        return np.asarray(binary_dilation(self.free, disc))

    @cached_property
    def pyramid(self) -> "Pyramid":
        """Maxima of the likelihood, by which the search bounds scores."""
        return Pyramid.of(self)


@dataclass(frozen=True)
class Pyramid:
    """Maxima of the likelihood over squares of 1, 2, 4, … cells, with a margin around the map."""

    margin: int
    """Number of cells added on each side of the map, since hits may lie beyond it."""
    levels: NDArray[np.uint8]
    """(level, row, col) the largest likelihood in the square of 2**level cells a side that begins
    at (row, col)."""
    phases: NDArray[np.uint8]
    """(phase row, phase col, block) the coarsest level in another order. Blocks are its squares
    side by side, numbered row by row; a phase is the position of a cell in its block. So for one
    phase the values of neighbouring blocks are neighbours in memory."""
    block_cols: int
    """Number of blocks in a row."""
    can_stand: NDArray[np.uint8]
    """(level, row, col) 1 where a robot can stand in some cell of this square, else 0."""

    @classmethod
    def of(cls, field: Field) -> Self:
        """Build the pyramid of a field."""
        block = 2**LEVELS
        margin = int(np.ceil(REACH_M / field.cell_m / block) + 1) * block
        map_rows, map_cols = field.walls.shape
        rows = margin + _rounded_up(map_rows, block) + margin
        cols = margin + _rounded_up(map_cols, block) + margin
        inside = np.s_[margin : margin + map_rows, margin : margin + map_cols]
        unknown = round(255 * UNKNOWN_SHARE)
        likelihood = np.full((rows, cols), unknown, np.uint8)
        likelihood[inside] = field.likelihood
        can_stand = np.zeros((rows, cols), np.uint8)
        can_stand[inside] = field.can_stand
        levels = _maxima(likelihood, unknown)
        phases = (
            levels[-1]
            .reshape(rows // block, block, cols // block, block)
            .transpose(1, 3, 0, 2)
            .reshape(block, block, -1)
        )
        return cls(
            margin, levels, np.ascontiguousarray(phases), cols // block, _maxima(can_stand, 0)
        )


def _rounded_up(side: int, block: int) -> int:
    """The number of cells in the whole blocks that `side` cells need."""
    return -(-side // block) * block


def _maxima(values: NDArray[np.uint8], beyond: int) -> NDArray[np.uint8]:
    """The maxima (level, row, col) over squares of 2**level cells a side that begin at each cell.

    `values` are (row, col); outside, the value is `beyond`.
    """
    levels = [values]
    for level in range(LEVELS):
        finer = levels[-1]
        half = 2**level  # a square consists of four squares of the finer level, this far apart
        padded = np.pad(finer, ((0, half), (0, half)), constant_values=beyond)
        along = np.maximum(padded[:, :-half], padded[:, half:])
        levels.append(np.maximum(along[:-half], along[half:]))
    return np.stack(levels)


def _merged(cells: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    """For each square of `side` x `side` cells (row, col), whether any of them is True."""
    rows, cols = cells.shape
    padded = np.zeros((_rounded_up(rows, side), _rounded_up(cols, side)), bool)
    padded[:rows, :cols] = cells
    squares = padded.reshape(padded.shape[0] // side, side, padded.shape[1] // side, side)
    return np.asarray(squares.any(axis=(1, 3)))


@njit(cache=True, nogil=True, inline="always")
def distance_at(distance_m, x, y, farthest_m):  # type: ignore[no-untyped-def]
    """The distance in metres to the nearest wall at x, y in cells, and its slopes along x and y.

    Between the centres of cells the distance (row, col) is interpolated; outside the map it is
    `farthest_m`. Slopes are in metres per cell.
    """
    rows, cols = distance_m.shape
    # from here on x and y are measured from the centre of cell (0, 0)
    x -= 0.5
    y -= 0.5
    col = int(np.floor(x))
    row = int(np.floor(y))
    if row < 0 or col < 0 or row >= rows - 1 or col >= cols - 1:
        return farthest_m, 0.0, 0.0
    along_x = x - col
    along_y = y - row
    low_slope_x = distance_m[row, col + 1] - distance_m[row, col]
    high_slope_x = distance_m[row + 1, col + 1] - distance_m[row + 1, col]
    low = distance_m[row, col] + along_x * low_slope_x
    high = distance_m[row + 1, col] + along_x * high_slope_x
    slope_y = high - low
    slope_x = (1 - along_y) * low_slope_x + along_y * high_slope_x
    return low + along_y * slope_y, slope_x, slope_y
