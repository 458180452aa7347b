"""Reads a 3-D point-cloud map to describe it or to draw it: a path in, a `PointMap` out.

The map is read once, block by block, and thinned as `yearloc pack --map` does, so it may be larger
than the memory.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.inspection.scan_or_map import FEWEST_POINTS, MOST_POINTS, is_scan
from pipeline.mapping.local_ground import LocalGround
from pipeline.mapping.tiled_map import Thinning, TiledMap
from pipeline.opening.map_files import MapFiles

VOXEL_M = 0.4
"""The map is thinned to one point in each voxel with this side, as `yearloc pack` does."""


@dataclass(frozen=True)
class PointMap:
    """A 3-D map as it is read to describe or to draw it."""

    files: MapFiles
    """The files, whose `tally` says what was read."""
    tiled: TiledMap
    """The thinned points, without strays."""
    strays: int
    """Number of voxels that were left out as strays."""
    ground: LocalGround | None
    """The ground; None if the map is too small or too wide for one to be fitted."""
    is_one_scan: bool
    """Whether the points are a scan that was taken from one place."""

    @classmethod
    def read(cls, path: Path, progress: Progress) -> Self:
        """Read the map at a path, a file or a folder of tiles.

        Raises LogError for files that are no map, NotInstalledError for LAS without the extra
        `las`, and InputError for points that are hundreds of kilometres apart.
        """
        files = MapFiles.of([path])
        thinning = Thinning(VOXEL_M)
        first_m = np.empty((0, 3))
        for points_m in files.chunks(progress):
            if not len(first_m):
                first_m = points_m[: MOST_POINTS + 1]
            thinning.add(points_m)
        tiled, strays = thinning.tiled().without_strays()
        ground = None
        if not tiled.unfit:
            tiles_m = progress.track(tiled.tiles_m(), len(tiled), "fit the ground")
            fitted = LocalGround.of(tiles_m)
            ground = fitted if np.isfinite(fitted.planes).any() else None
        is_whole = FEWEST_POINTS < len(first_m) == files.tally.points
        is_one_scan = is_whole and is_scan(first_m, _densest_m(first_m))
        return cls(files, tiled, strays, ground, is_one_scan)


def _densest_m(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle (3,) of the points in the densest column of 2 m."""
    if not len(points_m):
        return np.zeros(3)
    cells = np.floor(points_m[:, :2] / 2)
    _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(points_m[cell.ravel() == counts.argmax()].mean(axis=0))
