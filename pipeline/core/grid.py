"""The grid of places: positions in the world's xy plane in; the square cells that hold them out.

A place that training visited is one cell of this grid (SCI paper, II-C and IV-A; METHODS 2.2).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

UNSEEN = -1
"""The place id of a cell that training never visited."""


@dataclass(frozen=True)
class Grid:
    """A box of the xy plane, cut into whole cells with sides of about `cell_m`.

    Cell ids run along y first (x-major), from the lowest corner.
    """

    cell_m: float
    """The wanted side of a cell; the real one divides the box evenly."""
    x_m: tuple[float, float]
    """The box along x: lowest, highest."""
    y_m: tuple[float, float]
    """The box along y: lowest, highest."""

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if not high > low:
                raise InputError(f"{name}={low}…{high}: the box must have a length")
        if not self.cell_m > 0:
            raise InputError(f"cell_m={self.cell_m}: expected a length above 0")

    @property
    def shape(self) -> tuple[int, int]:
        """The number of cells along x and along y.

        It is extent / cell_m to the nearest whole number, with halves rounded up, as the authors of
        the SCI paper do.
        """
        x_count, y_count = (
            max(1, math.floor((high - low) / self.cell_m + 0.5))
            for low, high in (self.x_m, self.y_m)
        )
        return x_count, y_count

    def cell(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cell ids (n,) of positions (n, 2) in metres: the cell with the nearest centre.

        Positions outside the box belong to the nearest border cell; on a border between two cells
        the lower id wins. Raises InputError for a position that is not finite.
        """
        xy = np.asarray(xy, np.float64)
        if not np.isfinite(xy).all():
            raise InputError("a position to place in the grid is not finite")
        x_count, y_count = self.shape
        x_index = _index(xy[:, 0], self.x_m, x_count)
        y_index = _index(xy[:, 1], self.y_m, y_count)
        return x_index * y_count + y_index

    def extended(self, xy: NDArray[np.float64]) -> "Grid":
        """The grid with as many more cells of the same size on each side as positions (n, 2) need.

        On a side that grows, one empty cell lies beyond the outermost position.
        """
        low = np.array([self.x_m[0], self.y_m[0]])
        high = np.array([self.x_m[1], self.y_m[1]])
        side = (high - low) / self.shape
        lowest = xy.min(axis=0)
        highest = xy.max(axis=0)
        cells_before = np.ceil((low - lowest) / side) + 1
        cells_after = np.ceil((highest - high) / side) + 1
        # a position on the lower border would be in the cell below it
        cells_before = np.where(lowest <= low, np.maximum(cells_before, 0), 0)
        cells_after = np.where(highest > high, np.maximum(cells_after, 0), 0)
        x_low, y_low = (low - cells_before * side).tolist()
        x_high, y_high = (high + cells_after * side).tolist()
        return Grid(self.cell_m, (x_low, x_high), (y_low, y_high))

    def centre(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres (n, 2) in metres of cells (n,)."""
        index = np.stack(np.divmod(cells, self.shape[1]), axis=1)
        low = np.array([self.x_m[0], self.y_m[0]])
        side = (np.array([self.x_m[1], self.y_m[1]]) - low) / self.shape
        centres: NDArray[np.float64] = low + (index + 0.5) * side
        return centres


def _index(
    positions_m: NDArray[np.float64], box_m: tuple[float, float], count: int
) -> NDArray[np.int64]:
    """Indices (n,) of positions (n,) among `count` cells along one axis of the box."""
    low, high = box_m
    index = np.ceil((positions_m - low) * (count / (high - low))) - 1
    return index.clip(0, count - 1).astype(np.int64)


def around(xy: NDArray[np.float64], cell_m: float) -> Grid:
    """The grid of whole cells around positions (n, 2) in metres, with an empty cell on each side.

    A position outside the box then falls into a border cell that no position of `xy` is in, and so
    counts as unseen.
    """
    # a position on a border is in the lower cell
    low = (np.ceil(xy.min(axis=0) / cell_m) - 2) * cell_m
    high = (np.ceil(xy.max(axis=0) / cell_m) + 1) * cell_m
    return Grid(cell_m, (float(low[0]), float(high[0])), (float(low[1]), float(high[1])))
