"""A 3-D map with its ground, and with anchors on it wherever a scan may be taken (METHODS 15).

In: a map in tiles. Out: the same without stray points, the ground in each cell, and anchors on a
grid. A site is packed from these (online/map_pack.py), and so is the training day of a study that
learns a map (posing/map_day.py).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, transformed
from pipeline.core.progress import Progress
from pipeline.mapping.local_ground import LocalGround
from pipeline.mapping.no_map import hidden_share, upward
from pipeline.mapping.tiled_map import TiledMap

SPACING_M = 8.0
"""Distance of neighbouring anchors along each axis of their grid; a whole number of metres."""
NEAR_M = 20.0
"""A scan may have been taken this near to a point of the map."""
CELL_M = 1.0
"""Side of the cells by which nearness is judged."""
MOST_OF_A_SCAN = 200_000
"""A scan has no more voxels."""
LEAST_HIDDEN = 0.13
"""At least this share of a map's points is hidden behind others, seen from its origin: at most
.11 of a recorded scan, .15 of a map of the first 50 m of a drive, .5 and more of larger maps."""


@dataclass(frozen=True)
class AnchoredMap:
    """A map, its ground, and the anchors on it."""

    tiled: TiledMap
    ground: LocalGround
    world_T_anchor: Poses
    """(anchor, 4, 4) poses on the ground, on a grid of SPACING_M wherever a scan may be."""
    strays: int
    """Number of points in nearly empty tiles, which are left out."""

    @classmethod
    def of(
        cls,
        tiled: TiledMap,
        name: str,
        cut_m: float | None,
        progress: Progress,
        origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Self:
        """Fit the ground of a map, and set the anchors.

        `cut_m` is the height at which the ground is cut off, if it is known (local_ground.py);
        `origin_m` was subtracted from the points of the map's file. Raises InputError, which begins
        with `name`, for a single scan, for a map whose box is too large to draw or that is in other
        axes, and for one without ground.
        """
        tiled, strays = tiled.without_strays()
        if tiled.unfit:
            raise InputError(f"{name}: {tiled.unfit}")
        _refuse_scan(name, tiled, origin_m)
        ground = LocalGround.of(
            progress.track(tiled.tiles_m(), len(tiled), "fit the ground"), cut_m=cut_m
        )
        if not ground.has_ground:
            _refuse_axes(name, tiled)
        anchors = _anchors(tiled, ground)
        if not len(anchors):
            raise InputError(f"{name}: no ground can be fitted to its points")
        return cls(tiled, ground, anchors, strays)

    def square_m(self, row: int) -> NDArray[np.float64]:
        """The points (n, 3) in the square of SPACING_M around an anchor, in the anchor's frame.

        Each point of the map is in one square.
        """
        world_T_anchor = self.world_T_anchor[row]
        xy_m = world_T_anchor[:2, 3]
        world_m = self.tiled.around(xy_m, SPACING_M)
        is_inside = (_squares(world_m[:, :2]) == _squares(xy_m)).all(axis=1)
        return transformed(np.asarray(np.linalg.inv(world_T_anchor)), world_m[is_inside])


def _squares(xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """The squares (…, 2) of the grid in which positions (…, 2) lie."""
    return np.floor(xy_m / SPACING_M).astype(np.int64)


def _refuse_scan(name: str, tiled: TiledMap, origin_m: tuple[float, float, float]) -> None:
    """Raise InputError for a single scan around the origin of its file."""
    low_m, high_m = (edge_m + np.array(origin_m) for edge_m in tiled.box_m)
    if len(tiled.points) > MOST_OF_A_SCAN or (low_m[:2] > 0).any() or (high_m[:2] < 0).any():
        return
    points_m = np.concatenate(list(tiled.tiles_m())) + np.array(origin_m)
    if hidden_share(points_m) < LEAST_HIDDEN:
        raise InputError(
            f"{name}: its points are all seen from its origin, as those of one scan; expected a "
            "map with the points of all scans in one frame"
        )


def _refuse_axes(name: str, tiled: TiledMap) -> None:
    """Raise InputError for a map whose ground shows that z is not upwards."""
    if other := upward(tiled):
        up, coordinates = other
        raise InputError(
            f"{name}: its ground lies level if {up} is upwards; expected z upwards: save each "
            f"point as {coordinates}"
        )


def _anchors(tiled: TiledMap, ground: LocalGround) -> Poses:
    """Poses (n, 4, 4) on the ground, in the middle of each square of the grid that is near."""
    parts = [
        np.unique(np.floor(points_m[:, :2] / CELL_M).astype(np.int64), axis=0)
        for points_m in tiled.tiles_m()
    ]
    visited = np.concatenate(parts)
    border = int(np.ceil(NEAR_M / CELL_M))
    low = visited.min(axis=0) - border
    is_visited = np.zeros(visited.max(axis=0) - low + border + 1, bool)
    is_visited[tuple((visited - low).T)] = True
    is_near = maximum_filter(is_visited, 2 * border + 1)
    first, last = (_squares(np.array(cell) * CELL_M) for cell in (low, low + is_near.shape))
    squares = first + np.argwhere(np.ones(last - first + 1, bool))
    xy_m = (squares + 0.5) * SPACING_M
    cell = np.floor(xy_m / CELL_M).astype(np.int64) - low
    is_inside = ((cell >= 0) & (cell < is_near.shape)).all(axis=1)
    is_near_cell = is_near[tuple(cell[is_inside].T)]
    poses = ground.poses(xy_m[is_inside][is_near_cell])
    return poses[np.isfinite(poses).all(axis=(1, 2))]
