"""Places: the grid cells that the training sequence visited, numbered from 0 (METHODS 2.2).

Gives each submap its place and the other labels by which answers are judged.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.core.frames import Poses, wrapped_deg, yaw
from pipeline.core.grid import UNSEEN, Grid
from pipeline.core.schemas import Labels


@dataclass(frozen=True)
class Places:
    """The cells of a grid that training visited; each cell is a place."""

    grid: Grid
    cells: NDArray[np.int64]
    """(place,) the cell of each place: the cells of the first day in ascending order, then the
    cells that further days added."""

    @classmethod
    def of(cls, labels: Labels) -> Self:
        """Read the places of a training sequence from its labels."""
        return cls(Grid(labels.cell_m, labels.x_m, labels.y_m), labels.cells)

    def at(self, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The place (n,) of each position (n, 2); −1 in a cell that training never visited."""
        cells = self.grid.cell(xy_m)
        order = np.argsort(self.cells)
        rank = np.searchsorted(self.cells, cells, sorter=order)
        place = order[rank.clip(0, len(order) - 1)]
        is_place = self.cells[place] == cells
        return np.where(is_place, place, UNSEEN).astype(np.int64)

    def extended(self, xy_m: NDArray[np.float64]) -> Self:
        """The places with a new place for each further cell of positions (n, 2).

        The grid is extended if needed.
        """
        centres_m = self.grid.centre(self.cells)
        grid = self.grid.extended(xy_m)
        cells = grid.cell(centres_m)
        new_cells = np.setdiff1d(grid.cell(xy_m), cells)
        return type(self)(grid, np.concatenate([cells, new_cells]))


def label(world_T_anchor: Poses, world_T_training: Poses, grid: Grid, days: int) -> Labels:
    """Label the submaps anchored at `world_T_anchor` (n, 4, 4).

    A label gives the place in which a submap lies, and the nearest training anchor (m, 4, 4): its
    place, its distance and the turn from it. The submaps are `days` later than training.
    """
    xy_m = world_T_anchor[:, :2, 3]
    training_xy_m = world_T_training[:, :2, 3]
    training_cells = grid.cell(training_xy_m)
    cells, training_places = np.unique(training_cells, return_inverse=True)
    distance_m, nearest = scipy.spatial.KDTree(training_xy_m).query(xy_m)
    turn_deg = np.rad2deg(yaw(world_T_anchor) - yaw(world_T_training)[nearest])
    return Labels(
        Places(grid, cells).at(xy_m),
        cells,
        training_places[nearest].astype(np.int64),
        np.asarray(distance_m),
        wrapped_deg(turn_deg),
        days,
        grid.cell_m,
        grid.x_m,
        grid.y_m,
    )
