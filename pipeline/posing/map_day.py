"""The training day of a study that learns a 3-D map instead of a drive (METHODS 15).

In: an anchored map. Out: its squares as the scans of a day, which the chain draws and labels like
those of a drive; and the map itself, whose cut-outs queries are registered with. No sensor was at
an anchor, so nothing is validated with these scans (posing/map_verdict.py).
"""

from pathlib import Path

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.mapping.anchored_map import CELL_M, NEAR_M, AnchoredMap
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.matching.correlation import WallMap, drawn_map
from pipeline.views.walls import Walls as WallView

VOXEL_M = 0.4
"""The map has one point in each voxel with this side."""
RANGE_M = 60.0
"""A query is registered with the points within this distance of an anchor."""
BLOCK = 256
"""Squares that are written together."""
SECOND_NS = 10**9
"""Time between the stamps of two squares; they begin in 1970, since a map has no date."""


def drawn_walls(anchored: AnchoredMap, name: str, progress: Progress) -> WallMap:
    """The walls of a map from above, and where a scan may have been taken.

    Raises InputError, which begins with `name`, for a map without walls.
    """
    view = WallView()
    walls = [np.empty((0, 2), np.int64)]
    visited = [np.empty((0, 2), np.int64)]
    tiles_m = progress.track(anchored.tiled.tiles_m(), len(anchored.tiled), "draw the walls")
    for points_m in tiles_m:
        cells = np.floor(points_m[:, :2] / view.cell_m).astype(np.int64)
        above_m = points_m[:, 2] - anchored.ground.heights_m(points_m[:, :2])
        walls.append(cells[(above_m > view.low_m) & (above_m < view.high_m)])
        visited.append(np.unique(cells, axis=0))
    drawn = drawn_map(
        np.concatenate(walls), np.concatenate(visited), NEAR_M, view.cell_m, view.shape[0] // 2
    )
    if not drawn.counts.any():
        raise InputError(
            f"{name}: nothing stands {view.low_m:g} m or more above its ground: a map without "
            "walls or trees cannot be searched"
        )
    return drawn


def write_scans(path: Path, anchored: AnchoredMap, grain_m: float, progress: Progress) -> int:
    """Write the squares of a map as the scans of a day; returns the number of their points.

    Points are stored in units of `grain_m`, and each point of the map once.
    """
    anchors = anchored.world_T_anchor
    count = len(anchors)
    lengths: list[int] = []
    with store.draft(path, schemas.Scans, grain_m=grain_m, skipped={}, clipped=0) as out:
        starts = range(0, count, BLOCK)
        for start in progress.track(starts, len(starts), "cut squares"):
            rows = range(start, min(start + BLOCK, count))
            squares = [anchored.square_m(row) for row in rows]
            lengths += [len(square_m) for square_m in squares]
            out.append("points", np.rint(np.concatenate(squares) / grain_m).astype(np.int64))
        out.put("offsets", np.r_[0, np.cumsum(lengths)])
        out.put("stamps_ns", np.arange(count) * SECOND_NS)
        out.put("world_T_scan", anchors)
        out.put("odom_T_scan", np.full((count, 4, 4), np.nan))
        out.put("odom_variance", np.full((count, 2), np.nan))
    return sum(lengths)


def write_map(
    path: Path, anchored: AnchoredMap, drawn: WallMap, voxel_m: float, range_m: float
) -> None:
    """Write the map that queries are registered with: its tiles, its anchors and its walls.

    `range_m` is the range of a cut-out.
    """
    artifact = schemas.TiledMaps(
        **anchored.tiled.arrays,
        world_T_anchor=anchored.world_T_anchor,
        walls=drawn.counts,
        walls_corner_m=np.asarray(drawn.corner_m, np.float64),
        grain_m=GRAIN_M,
        voxel_m=voxel_m,
        range_m=range_m,
        cell_m=CELL_M,
    )
    store.write(path, artifact)
