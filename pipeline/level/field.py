"""Likelihood fields: how near a wall each cell is, and a pyramid of maxima over it.

After Thrun, Burgard and Fox, Probabilistic Robotics, section 6.4, and Olson, Real-Time Correlative
Scan Matching, ICRA 2009.
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
"""Cells of the field are at least so large: finer ones cost time and find nothing more."""
SIGMA_M = 0.2
"""Standard deviation of a hit about its wall while searching."""
UNKNOWN_SHARE = 0.15
"""Likelihood of a hit in unknown space, against 1 on a wall: new ground is no contradiction."""
STAND_M = 0.3
"""A robot stands in free space, or so near to it."""
FARTHEST_M = 2.0
"""Distances to walls are kept up to here."""
LEVELS = 3
"""The coarsest nodes of the search are 2**LEVELS cells wide."""
REACH_M = 30.0
"""Hits of a query farther from it than this are not searched for."""


@dataclass(frozen=True)
class Field:
    """A level map prepared for the search, in its own grid: x along columns, y along rows."""

    cell_m: float
    distance_m: NDArray[np.float32]
    """(row, col) from each cell's centre to the nearest wall's, at most FARTHEST_M."""
    walls: NDArray[np.bool_]
    """(row, col)."""
    free: NDArray[np.bool_]
    """(row, col)."""
    world_T_grid: NDArray[np.float64]
    """(4, 4)."""

    @classmethod
    def of(cls, level_map: LevelMap) -> Self:
        """Prepare a map; several of its cells make one of the field where they are small.

        A cell is a wall where one of them is, else free where one of them is.
        """
        times = max(1, round(CELL_M / level_map.cell_m))
        walls = _merged(level_map.walls, times)
        free = _merged(level_map.free, times) & ~walls
        cell_m = level_map.cell_m * times
        distance_m = cell_m * distance_transform_edt(~walls)
        return cls(
            cell_m,
            np.minimum(distance_m, FARTHEST_M).astype(np.float32),
            walls,
            free,
            level_map.world_T_grid,
        )

    @cached_property
    def likelihood(self) -> NDArray[np.uint8]:
        """(row, col) of a hit there, in 255ths."""
        near = np.exp(-(self.distance_m.astype(np.float64) ** 2) / (2 * SIGMA_M**2))
        unknown = ~self.free & ~self.walls
        near[unknown] = np.maximum(near[unknown], UNKNOWN_SHARE)
        return np.asarray(np.rint(255 * near).astype(np.uint8))

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """(row, col) where a robot may stand."""
        reach = int(np.ceil(STAND_M / self.cell_m))
        y, x = np.ogrid[-reach : reach + 1, -reach : reach + 1]
        disc = x**2 + y**2 <= (STAND_M / self.cell_m) ** 2
        return np.asarray(binary_dilation(self.free, disc))

    @cached_property
    def pyramid(self) -> "Pyramid":
        """The maxima that the search bounds with."""
        return Pyramid.of(self)


@dataclass(frozen=True)
class Pyramid:
    """Maxima of the likelihood over squares of 1, 2, 4, … cells, with a margin around the map."""

    margin: int
    """Cells around the map on each side: hits may lie beyond it."""
    levels: NDArray[np.uint8]
    """(level, row, col) the largest likelihood of the 2**level cells from (row, col) on."""
    phases: NDArray[np.uint8]
    """(row in block, col in block, block) the coarsest level, so that the cells of one phase are
    neighbours."""
    block_cols: int
    """Blocks in a row of the coarsest level."""
    stands: NDArray[np.uint8]
    """(level, row, col) whether a robot may stand in one of these cells, margin included."""

    @classmethod
    def of(cls, field: Field) -> Self:
        """Build the pyramid of a field."""
        block = 2**LEVELS
        margin = int(np.ceil(REACH_M / field.cell_m / block) + 1) * block
        rows, cols = (margin + -(-side // block) * block + margin for side in field.walls.shape)
        unknown = round(255 * UNKNOWN_SHARE)
        lowest = np.full((rows, cols), unknown, np.uint8)
        stands = np.zeros((rows, cols), np.uint8)
        inside = tuple(slice(margin, margin + side) for side in field.walls.shape)
        lowest[inside] = field.likelihood
        stands[inside] = field.stands
        levels = _maxima(lowest, unknown)
        phases = (
            levels[-1]
            .reshape(rows // block, block, cols // block, block)
            .transpose(1, 3, 0, 2)
            .reshape(block, block, -1)
        )
        return cls(margin, levels, np.ascontiguousarray(phases), cols // block, _maxima(stands, 0))


def _maxima(lowest: NDArray[np.uint8], beyond: int) -> NDArray[np.uint8]:
    """(level, row, col) maxima over squares of 2**level cells from each cell on."""
    levels = [lowest]
    for level in range(LEVELS):
        below = levels[-1]
        half = 2**level
        padded = np.pad(below, ((0, half), (0, half)), constant_values=beyond)
        along = np.maximum(padded[:, :-half], padded[:, half:])
        levels.append(np.maximum(along[:-half], along[half:]))
    return np.stack(levels)


def _merged(cells: NDArray[np.bool_], times: int) -> NDArray[np.bool_]:
    """Whether any of `times` x `times` cells is set."""
    rows, cols = (-(-side // times) for side in cells.shape)
    padded = np.zeros((rows * times, cols * times), bool)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(rows, times, cols, times).any(axis=(1, 3)))


@njit(cache=True, nogil=True, inline="always")
def distance_at(distance_m, x, y, farthest_m):  # type: ignore[no-untyped-def]
    """Distance in metres to the nearest wall and its slope along x and y, per cell.

    x and y are in cells; between the centres of cells the distance is interpolated.
    """
    rows, cols = distance_m.shape
    x -= 0.5
    y -= 0.5
    col = int(np.floor(x))
    row = int(np.floor(y))
    if row < 0 or col < 0 or row >= rows - 1 or col >= cols - 1:
        return farthest_m, 0.0, 0.0
    u = x - col
    v = y - row
    a = distance_m[row, col]
    b = distance_m[row, col + 1]
    c = distance_m[row + 1, col]
    d = distance_m[row + 1, col + 1]
    low = a + u * (b - a)
    high = c + u * (d - c)
    return low + v * (high - low), (1 - v) * (b - a) + v * (d - c), high - low
