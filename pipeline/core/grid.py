"""The grid of places: the world's xy plane cut into square cells (SCI paper, II-C and IV-A; METHODS
2.2)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

UNSEEN = -1


@dataclass(frozen=True)
class Grid:
    """Cells of about `cell_m` over a box.

    Ids run along y first (x-major), from the lowest corner.
    """

    cell_m: float
    x_m: tuple[float, float]
    y_m: tuple[float, float]

    def __post_init__(self) -> None:
        for name, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if not high > low:
                raise InputError(f"{name}={low}…{high}: the box must have a length")
        if not self.cell_m > 0:
            raise InputError(f"cell_m={self.cell_m}: expected a length above 0")

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along x and y: extent / cell_m to the nearest whole number.

        Halves are rounded up, as the authors do.
        """
        return tuple(
            max(1, math.floor((high - low) / self.cell_m + 0.5))
            for low, high in (self.x_m, self.y_m)
        )  # type: ignore[return-value]

    def cell(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cell ids (n,) of positions (n, 2): the cell with the nearest centre.

        Positions outside the box belong to the border cell; on a border between two cells the lower
        id wins.
        """
        xy = np.asarray(xy, np.float64)
        if not np.isfinite(xy).all():
            raise InputError("a position to place in the grid is not finite")
        axes: list[NDArray[np.int64]] = []
        for axis, ((low, high), count) in enumerate(
            zip((self.x_m, self.y_m), self.shape, strict=True)
        ):
            index = np.ceil((xy[:, axis] - low) * (count / (high - low))) - 1
            axes.append(index.clip(0, count - 1).astype(np.int64))
        return axes[0] * self.shape[1] + axes[1]

    def extended(self, xy: NDArray[np.float64]) -> "Grid":
        """The same cells, and as many more on each side as positions (n, 2) need.

        An empty cell lies beyond them.
        """
        low, high = (np.array(side) for side in zip(self.x_m, self.y_m, strict=True))
        side = (high - low) / self.shape
        before = np.maximum(np.ceil((low - xy.min(axis=0)) / side) + 1, 0) * (xy.min(axis=0) <= low)
        after = np.maximum(np.ceil((xy.max(axis=0) - high) / side) + 1, 0) * (xy.max(axis=0) > high)
        (x_low, y_low) = (low - before * side).tolist()
        (x_high, y_high) = (high + after * side).tolist()
        return Grid(self.cell_m, (x_low, x_high), (y_low, y_high))

    def centre(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres (n, 2) in metres of cells (n,)."""
        index = np.stack(np.divmod(cells, self.shape[1]), axis=1)
        low = np.array([self.x_m[0], self.y_m[0]])
        side = (np.array([self.x_m[1], self.y_m[1]]) - low) / self.shape
        centres: NDArray[np.float64] = low + (index + 0.5) * side
        return centres


def around(xy: NDArray[np.float64], cell_m: float) -> Grid:
    """The grid of whole cells around positions (n, 2), with one empty cell on each side.

    What lies outside the box then falls into a border cell that no position of `xy` is in, hence is
    unseen.
    """
    # a position on a border is in the lower cell
    low = (np.ceil(xy.min(axis=0) / cell_m) - 2) * cell_m
    high = (np.ceil(xy.max(axis=0) / cell_m) + 1) * cell_m
    return Grid(cell_m, (float(low[0]), float(high[0])), (float(low[1]), float(high[1])))
