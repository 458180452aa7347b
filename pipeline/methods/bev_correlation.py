"""BEV correlation: correlative scan matching of a scan's walls with the walls of the whole map,
from above (ours; METHODS 15; Olson, ICRA 2009).

Nothing is trained. `learn` draws the walls of all training views into one map. `localizer` finds
the positions and headings at which a query's walls fit it best, wherever training was on its way:
also beside the training path, and on a 3-D map that has no path (`pipeline/online/map_pack.py`).
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.errors import InputError
from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, checked
from pipeline.mapping.wall_chart import WALL
from pipeline.matching.correlation import FEWEST, Correlation, Fits, WallMap, drawn_map
from pipeline.matching.database import Database, DescriptorMethod
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import NoveltyEvidence

KIND = "misfit"
"""The only kind of novelty: one minus the score of the best position."""
NO_EVIDENCE = NoveltyEvidence(
    np.empty(0, bool), {KIND: np.empty(0)}, {KIND: np.empty(0)}, np.empty(0, np.int64)
)
"""What is known without validation blocks: with it, all queries are rejected."""


@dataclass(frozen=True)
@checked("method")
class BevCorrelation(DescriptorMethod):
    """The settings of the search."""

    view: str = "walls"
    cell_m: Positive = 1.0
    """Side of a cell of the map; the view's cells have the same."""
    candidates_m: Positive = 6.0
    """A query is searched for up to this distance from the training anchors."""
    headings: Count = 60
    """Number of headings that are tried first, evenly spaced around the circle."""
    see_through: NotNegative = 0.3
    """A seen-through cell on a wall of the map costs this share of what a wall on a wall gains."""
    blocks: Count = 2000
    """Number of blocks of 8 m of which all positions are computed."""
    apart_m: Positive = 4.0
    """Answers are at least this far apart."""
    of_map: bool = False
    """Whether the training views are of the squares of a 3-D map (posing/map_day.py): each wall is
    in one view only, and nothing is validated with them."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Draw the map of the training views; raises InputError unless each view has a place."""
        database = Database.learned(views, places)
        reach_cells = views.images.shape[1] // 2
        images = np.asarray(views.images[:])

        def search(
            queries: NDArray[np.int64], is_allowed: NDArray[np.bool_]
        ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
            """A `database.Search`: the map is drawn from the rows that any query may use.

            Positions whose nearest row a query may not use are left out.
            """
            is_drawn = is_allowed.any(axis=0)
            drawn = self._drawn(images[is_drawn], views.world_T_anchor[is_drawn], reach_cells)
            tree = KDTree(database.xy_m)
            misfits = np.ones(len(queries))
            rows = np.empty(len(queries), np.int64)
            for i, query in enumerate(queries):
                fits = self.fits(drawn, images[query], k=100)
                nearest = np.asarray(tree.query(fits.xy_m)[1])
                columns = np.flatnonzero(is_allowed[i, nearest])
                rows[i] = nearest[columns[0]] if len(columns) else is_allowed[i].argmax()
                misfits[i] = 1 - fits.scores[columns[0]] if len(columns) else 1.0
            return misfits, rows

        evidence = NO_EVIDENCE if self.of_map else database.evidence(search, views, self, KIND)
        drawn = self._drawn(images, views.world_T_anchor, reach_cells)
        return {
            **drawn.arrays,
            **database.arrays(),
            **evidence.arrays(),
        }

    def localizer(self, model: Model) -> Localizer:
        """Rank the positions that fit best; cost and novelty are one minus their score."""
        return BevLocalizer(self, Database.of(model), WallMap.of_arrays(model, self.cell_m))

    def fits(self, drawn: WallMap, image: NDArray[np.int8], k: int) -> Fits:
        """The best positions of one view (x, y); raises InputError for a view of another size."""
        if image.shape != (2 * drawn.reach_cells, 2 * drawn.reach_cells):
            raise InputError(
                f"a view of shape {image.shape}: expected {2 * drawn.reach_cells} cells a side"
            )
        search = Correlation(self.headings, self.see_through, self.blocks, self.apart_m)
        return drawn.fits(image, k, search)

    def _drawn(
        self, images: NDArray[np.int8], world_T_anchor: NDArray[np.float64], reach_cells: int
    ) -> WallMap:
        """The map of views (n, x, y) at poses (n, 4, 4): in how many views a cell is a wall."""
        cells = [np.empty((0, 2), np.int64)]
        for image, pose in zip(images, world_T_anchor, strict=True):
            middles_m = (np.argwhere(image == WALL) - reach_cells + 0.5) * self.cell_m
            level_m = np.column_stack([middles_m, np.zeros(len(middles_m))])
            drawn_cells = np.floor(transformed(pose, level_m)[:, :2] / self.cell_m)
            cells.append(np.unique(drawn_cells.astype(np.int64), axis=0))
        wall = np.concatenate(cells)
        if self.of_map:  # no wall is taken for a stray
            wall = np.repeat(wall, FEWEST, axis=0)
        anchor = np.floor(world_T_anchor[:, :2, 3] / self.cell_m).astype(np.int64)
        return drawn_map(wall, anchor, self.candidates_m, self.cell_m, reach_cells)


class BevLocalizer:
    """Ranks the positions of a map that fit a view best."""

    def __init__(self, method: BevCorrelation, database: Database, drawn: WallMap) -> None:
        self._method = method
        self._database = database
        self._drawn = drawn
        self._tree = KDTree(database.xy_m)

    def near(self, xy_m: NDArray[np.float64], reach_m: float) -> "BevLocalizer":
        """The same search, of the positions up to `reach_m` from a position (2,) alone."""
        narrowed = copy(self)
        narrowed._drawn = self._drawn.near(xy_m, reach_m)
        return narrowed

    def __call__(self, views: Rows, k: int) -> Ranking:
        """The `k` best positions of each view; cost and novelty are one minus their score."""
        images = np.asarray(views.images[:])
        places = np.full((len(images), k), -1, np.int64)
        costs = np.full((len(images), k), np.inf, np.float32)
        xy_m = np.full((len(images), k, 2), np.nan)
        heading_deg = np.full((len(images), k), np.nan, np.float32)
        for i, image in enumerate(images):
            fits = self._method.fits(self._drawn, image, k)
            found = slice(len(fits.scores))
            nearest = np.asarray(self._tree.query(fits.xy_m)[1])
            places[i, found] = self._database.places[nearest]
            costs[i, found] = 1 - fits.scores
            xy_m[i, found] = fits.xy_m
            heading_deg[i, found] = fits.heading_deg
        novelty = np.where(np.isfinite(costs[:, :1]), costs[:, :1], 1.0)
        confidence = np.full(len(images), np.nan, np.float32)
        return Ranking(places, costs, xy_m, novelty, confidence, heading_deg, (KIND,))
