"""The walls of the whole map from above: where else a query fits (METHODS 9.2).

In: the walls of all submaps, drawn into one map, and the walls of a query. Out: the positions and
headings of the whole map at which the query fits best, and how well it fits at a given pose. So the
search for a pose finds places that the ranking has missed, and perceptual aliases at any distance.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import RIGHT_WITHIN, transformed, wrapped_deg, yaw
from pipeline.core.settings import Count, Positive, checked
from pipeline.mapping.wall_chart import WALL, wall_points
from pipeline.matching.correlation import Correlation, Fits, WallMap, drawn_map
from pipeline.posing.walls import cell_numbers
from pipeline.views.walls import Walls as WallView

RIGHT_M, _ = RIGHT_WITHIN
TURNED_DEG = 45.0
"""A fit at a pose that is turned by more than this from it is an alias, not the pose itself."""


@dataclass(frozen=True)
@checked("whole_map")
class WholeMap:
    """How the map's walls are drawn and searched."""

    view: WallView = field(default_factory=WallView)
    """Draws the walls of a query, and of each submap."""
    correlation: Correlation = field(default_factory=Correlation)
    candidates_m: Positive = 6.0
    """A query is searched for up to this distance from the submaps' anchors."""
    count: Count = 10
    """Number of positions to find."""

    def scan(self, points_m: NDArray[np.float64], is_single_scan: bool) -> NDArray[np.int8]:
        """The walls (x, y) of a query's points (n, 3) from above.

        Several scans have no common viewpoint: then no cell counts as seen through.
        """
        image = self.view(points_m)
        return image if is_single_scan else np.where(image == WALL, image, 0).astype(np.int8)

    def wall_cells(
        self, points_m: NDArray[np.float64], world_T_anchor: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """The cells (n, 2) of the world with walls of a submap's points (m, 3); each cell once."""
        view = self.view
        walls_m = wall_points(points_m, view.low_m, view.high_m, view.range_m)
        cells = np.floor(transformed(world_T_anchor, walls_m)[:, :2] / view.cell_m)
        cells = cells.astype(np.int64)
        _, first = np.unique(cell_numbers(cells), return_index=True)
        return np.asarray(cells[first])

    def drawn(self, cells: list[NDArray[np.int64]], anchors_m: NDArray[np.float64]) -> WallMap:
        """The map of the wall cells of all submaps, whose anchors (row, 2) are in metres."""
        view = self.view
        visited = np.floor(anchors_m / view.cell_m).astype(np.int64)
        walls = np.concatenate([np.empty((0, 2), np.int64), *cells])
        reach_cells = view.shape[0] // 2
        return drawn_map(walls, visited, self.candidates_m, view.cell_m, reach_cells)


@dataclass(frozen=True)
class Slid:
    """A query that is slid over the walls of the whole map."""

    settings: WholeMap
    walls: WallMap
    scan: NDArray[np.int8]
    """(x, y) the query's walls from above."""

    @cached_property
    def fits(self) -> Fits:
        """The best positions in the whole map, the best first."""
        return self.walls.fits(self.scan, self.settings.count, self.settings.correlation)

    def score_at(self, world_T_query: NDArray[np.float64]) -> float:
        """How well the query fits at a pose (4, 4), as `Fits.scores` measures it."""
        heading_deg = float(np.rad2deg(yaw(world_T_query)))
        return self.walls.score_at(
            self.scan, world_T_query[:2, 3], heading_deg, self.settings.correlation
        )

    def elsewhere(
        self, world_T_query: NDArray[np.float64], from_m: float, score_at_pose: float
    ) -> NDArray[np.int64]:
        """The numbers of the `fits` that are not at a pose (4, 4): `from_m` or TURNED_DEG away.

        Fits that are nearer, but farther away than a right pose is, are elsewhere if they fit
        better than the pose.
        """
        away_m = np.linalg.norm(self.fits.xy_m - world_T_query[:2, 3], axis=1)
        turn_deg = np.abs(wrapped_deg(self.fits.heading_deg - np.rad2deg(yaw(world_T_query))))
        is_elsewhere = (away_m >= from_m) | (turn_deg >= TURNED_DEG)
        is_better = (away_m >= RIGHT_M) & (self.fits.scores > score_at_pose)
        return np.flatnonzero(is_elsewhere | is_better)
