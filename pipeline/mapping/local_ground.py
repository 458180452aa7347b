"""The ground of a 3-D map: height and slope in each cell, also where the map itself is tilted.

Maps that people have are seldom level, and often their ground was cut off (METHODS 15).

1. The lowest points of each cell are candidates for the ground.
2. A plane is fitted to the candidates around each cell. Those above it count less, since they are
   of cars, roofs and trees.
3. If few of a cell's columns have a point near these planes, the ground was cut off: the planes are
   lowered by the height of the cut.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import Poses

CELL_M = 10.0
"""Side of a cell; tiles (tiled_map.TILE_M) are whole numbers of cells."""
LOWEST_SHARE = 0.02
"""The candidate of a cell is this quantile of its heights: the lowest points may be strays."""
FEWEST_POINTS = 10
"""A cell of fewer points has no candidate."""
REACH_CELLS = 4
"""Candidates up to so many cells away, along each axis, count for a plane."""
SD_CELLS = 1.5
"""Their weight falls as a Gaussian of this standard deviation."""
ABOVE_M = 0.3
BELOW_M = 1.0
"""A candidate this far above or below the plane has half its weight."""
FEWEST_CANDIDATES = 5
ROUNDS = 8
"""Rounds of reweighted least squares."""
COLUMN_M = 1.0
NEAR_GROUND_M = 0.25
"""A column of this width shows the ground if it has a point this near to the plane."""
GROUND_SHARE = 0.4
"""A cell of which fewer of the columns with points show the ground has lost its ground."""
USUAL_CUT_M = 0.3
"""The height at which ground is cut off, if nothing else is known."""


@dataclass(frozen=True)
class LocalGround:
    """The plane of the ground in each cell of a grid."""

    corner_m: NDArray[np.float64]
    """(2,) the lower corner of the grid."""
    planes: NDArray[np.float64]
    """(x, y, 3) the height at the centre of each cell, and its slopes along x and y; NaN where
    there is no ground."""
    has_ground: bool
    """Whether the map has the points of the ground."""

    @classmethod
    def of(cls, tiles_m: Iterable[NDArray[np.float64]], cut_m: float | None = None) -> Self:
        """Fit the ground of a map's tiles (n, 3), in metres.

        `cut_m` is the height above the ground below which the map has no points; without it, the
        map's own points say whether its ground was cut, at USUAL_CUT_M.
        """
        cells: list[NDArray[np.int64]] = []
        lows_m: list[NDArray[np.float64]] = []
        shown: list[NDArray[np.float64]] = []
        for points_m in tiles_m:
            tile_cells, tile_lows_m, tile_shown = _candidates(points_m)
            cells.append(tile_cells)
            lows_m.append(tile_lows_m)
            shown.append(tile_shown)
        cell = np.concatenate(cells)
        low = cell.min(axis=0) - REACH_CELLS
        shape = cell.max(axis=0) - low + REACH_CELLS + 1
        candidates_m = np.full(shape, np.nan)
        candidates_m[tuple((cell - low).T)] = np.concatenate(lows_m)
        has_ground = cut_m is None and float(np.nanmedian(np.concatenate(shown))) > GROUND_SHARE
        if not has_ground:
            candidates_m -= USUAL_CUT_M if cut_m is None else cut_m
        return cls(low * CELL_M, _planes(candidates_m), has_ground)

    def heights_m(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The height (n,) of the ground at positions (n, 2); NaN where there is none."""
        planes, offset_m = self._planes_at(xy_m)
        return np.asarray(planes[:, 0] + np.vecdot(planes[:, 1:], offset_m))

    def poses(self, xy_m: NDArray[np.float64]) -> Poses:
        """Poses (n, 4, 4) on the ground at positions (n, 2): z along its normal, x along the
        world's x axis, as far as the slope lets it; NaN where there is no ground."""
        planes, _ = self._planes_at(xy_m)
        z_axis = np.column_stack([-planes[:, 1:], np.ones(len(xy_m))])
        z_axis /= np.linalg.norm(z_axis, axis=1, keepdims=True)
        y_axis = np.cross(z_axis, [1.0, 0.0, 0.0])
        y_axis /= np.linalg.norm(y_axis, axis=1, keepdims=True)
        poses = np.tile(np.eye(4), (len(xy_m), 1, 1))
        poses[:, :3, 0] = np.cross(y_axis, z_axis)
        poses[:, :3, 1] = y_axis
        poses[:, :3, 2] = z_axis
        poses[:, :2, 3] = xy_m
        poses[:, 2, 3] = self.heights_m(xy_m)
        return poses

    @property
    def tilt_deg(self) -> NDArray[np.float64]:
        """(x, y) the angle between the ground and the level; NaN where there is no ground."""
        return np.asarray(np.rad2deg(np.arctan(np.hypot(self.planes[..., 1], self.planes[..., 2]))))

    def _planes_at(
        self, xy_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The plane (n, 3) at positions (n, 2), and their offsets (n, 2) from its cell's centre."""
        cell = np.floor((xy_m - self.corner_m) / CELL_M).astype(np.int64)
        is_inside = ((cell >= 0) & (cell < self.planes.shape[:2])).all(axis=1)
        planes = np.full((len(xy_m), 3), np.nan)
        planes[is_inside] = self.planes[tuple(cell[is_inside].T)]
        return planes, xy_m - (self.corner_m + (cell + 0.5) * CELL_M)


def _candidates(
    points_m: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Cells (c, 2) with a candidate (c,), and the share (c,) of their columns that have a point
    near it, of those that have any point."""
    cell = np.floor(points_m[:, :2] / CELL_M).astype(np.int64)
    order = np.lexsort((points_m[:, 2], cell[:, 1], cell[:, 0]))
    cell, points_m = cell[order], points_m[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)])
    counts = np.diff(np.r_[starts, len(cell)])
    is_candidate = counts >= FEWEST_POINTS
    starts, counts = starts[is_candidate], counts[is_candidate]
    lows_m = points_m[starts + (counts * LOWEST_SHARE).astype(np.int64), 2]
    shown = np.empty(len(starts))
    for i, (start, count) in enumerate(zip(starts, counts, strict=True)):
        part_m = points_m[start : start + count]
        columns = np.floor(part_m[:, :2] / COLUMN_M).astype(np.int64) @ (1 << 20, 1)
        is_near = part_m[:, 2] < lows_m[i] + NEAR_GROUND_M
        shown[i] = len(np.unique(columns[is_near])) / len(np.unique(columns))
    return cell[starts].reshape(-1, 2), lows_m, shown


@njit(cache=True, nogil=True, error_model="numpy")
def _planes(candidates_m):  # type: ignore[no-untyped-def]
    """The plane (x, y, 3) around each cell of candidates (x, y), by reweighted least squares."""
    x_count, y_count = candidates_m.shape
    planes = np.full((x_count, y_count, 3), np.nan)
    side = 2 * REACH_CELLS + 1
    x_m = np.empty(side * side)
    y_m = np.empty(side * side)
    z_m = np.empty(side * side)
    near = np.empty(side * side)
    for i in range(x_count):
        for j in range(y_count):
            count = 0
            for a in range(max(0, i - REACH_CELLS), min(x_count, i + REACH_CELLS + 1)):
                for b in range(max(0, j - REACH_CELLS), min(y_count, j + REACH_CELLS + 1)):
                    if np.isfinite(candidates_m[a, b]):
                        x_m[count] = (a - i) * CELL_M
                        y_m[count] = (b - j) * CELL_M
                        z_m[count] = candidates_m[a, b]
                        squares = (a - i) ** 2 + (b - j) ** 2
                        near[count] = np.exp(-squares / (2 * SD_CELLS**2))
                        count += 1
            if count < FEWEST_CANDIDATES:
                continue
            plane = np.array([np.median(z_m[:count]), 0.0, 0.0])
            for _ in range(ROUNDS):
                normal = np.zeros((3, 3))
                right = np.zeros(3)
                total = 0.0
                for c in range(count):
                    off_m = z_m[c] - plane[0] - plane[1] * x_m[c] - plane[2] * y_m[c]
                    scale_m = ABOVE_M if off_m > 0 else BELOW_M
                    weight = near[c] / (1 + (off_m / scale_m) ** 2)
                    total += weight
                    row = np.array([1.0, x_m[c], y_m[c]])
                    for e in range(3):
                        right[e] += weight * row[e] * z_m[c]
                        for f in range(3):
                            normal[e, f] += weight * row[e] * row[f]
                # Slopes are pulled to 0, so that candidates in one line give no wild plane.
                for e in range(1, 3):
                    normal[e, e] += total * 0.1 * CELL_M**2
                plane = np.linalg.solve(normal, right)
            planes[i, j] = plane
    return planes
