"""Cut-outs: the targets of a 3-D map, whose sensor's positions are unknown (METHODS 15).

A cut-out has the points of the map around an anchor, in the frame of the ground there. Anchors
stand on a grid. Nothing says what the map's sensor saw through, so only the query's seen-through
space contradicts a pose. The ranking has searched the whole map already (methods/bev_correlation),
so its answers, with their headings, are the only candidates.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.frames import transformed
from pipeline.mapping.tiled_map import ARRAYS, GRAIN_M, TiledMap
from pipeline.mapping.wall_chart import BLOCK, Chart, bounded
from pipeline.matching.correlation import WallMap
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets
from pipeline.posing.walls import Walls


def read_targets(path: Path) -> Targets:
    """Read the targets of a map artifact: the submaps of a drive, or cut-outs of a 3-D map.

    Raises ArtifactError if there is none.
    """
    is_tiled = isinstance(store.read(path, schemas.Maps, schemas.TiledMaps), schemas.TiledMaps)
    return CutOuts.read(path) if is_tiled else Targets.read(path)


CACHED_CLOUDS = 32
"""Number of prepared cut-outs kept in memory, of some 10 MB each."""


class CutOuts(Targets):
    """The cut-outs of a map around anchors, one a row."""

    is_map = True

    def __init__(
        self,
        arrays: Mapping[str, NDArray[Any]],
        drawn: WallMap,
        grain_m: float,
        range_m: float,
    ) -> None:
        """Build them from a site's arrays, the anchors and the tiles, and its map of walls."""
        if grain_m != GRAIN_M:
            raise ValueError(f"grain_m={grain_m}: expected {GRAIN_M}")
        super().__init__(arrays, grain_m, range_m, single=False, cached_clouds=CACHED_CLOUDS)
        self.tiled_map = TiledMap.of_arrays(arrays)
        self.drawn = drawn

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the cut-outs of an artifact of a map; raises ArtifactError if there is none."""
        artifact = store.read(path, schemas.TiledMaps)
        counts = artifact.load("walls")
        nowhere = np.zeros(counts.shape, bool)  # candidates are the ranking's business
        reach_cells = int(np.ceil(artifact.range_m / artifact.cell_m))
        drawn = WallMap(
            counts, nowhere, artifact.load("walls_corner_m"), artifact.cell_m, reach_cells
        )
        arrays = {name: artifact.load(name) for name in (*ARRAYS, "world_T_anchor")}
        return cls(arrays, drawn, artifact.grain_m, artifact.range_m)

    def points_m(self, row: int) -> Points:
        """The points (n, 3) of the map around a row's anchor, in the anchor's frame."""
        world_T_anchor = self.world_T_anchor[row]
        world_m = self.tiled_map.around(world_T_anchor[:2, 3], self.range_m)
        return transformed(np.asarray(np.linalg.inv(world_T_anchor)), world_m)

    def above_ground_m(self, low_m: float) -> Points:
        """The points (n, 3) of the map, in the world, that lie `low_m` or more above the ground."""
        parts = [points_m[above_m > low_m] for points_m, above_m in self.heights()]
        return np.concatenate([np.empty((0, 3)), *parts])

    def heights(self) -> Iterator[tuple[Points, NDArray[np.float64]]]:
        """The points (n, 3) of each tile, in the world, and their heights (n,) above the ground."""
        tree = KDTree(self.world_T_anchor[:, :2, 3])
        for points_m in self.tiled_map.tiles_m():
            _, row = tree.query(points_m[:, :2])
            anchor_T_world = np.linalg.inv(self.world_T_anchor[row])
            above_m = np.vecdot(anchor_T_world[:, 2, :3], points_m) + anchor_T_world[:, 2, 3]
            yield points_m, above_m

    def _chart(self, walls: Walls, row: int) -> Chart:
        """The walls of the map around a row's anchor, whose axes are the world's from above."""
        if walls.cell_m != self.drawn.cell_m:
            return super()._chart(walls, row)
        anchor_xy_m = self.world_T_anchor[row, :2, 3]
        return bounded(self.drawn.window(anchor_xy_m, walls.half_width_cells + BLOCK), BLOCK)
