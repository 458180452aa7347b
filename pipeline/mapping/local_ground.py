"""The ground of a 3-D map: height and slope in each cell, also where the map itself is tilted.

Maps that people have are seldom level, and often their ground was cut off (METHODS 15).

1. One of the lowest points of each cell is a candidate for the ground.
2. A plane is fitted to the candidates around each cell. Those above it count less, since they are
   of cars, roofs and trees.
3. If few of a cell's columns have a point near these planes and nothing just above it, the ground
   was cut off: the planes are lowered by the height of the cut.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
"""A column of this width shows the ground if its lowest point is this near to the plane, ..."""
OPEN_M = 1.0
"""... and no point stands up to this far above it, as those of walls and bushes do."""
GROUND_SHARE = 0.1
"""If fewer of a cell's columns with points show the ground, in the median, it was cut off."""
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
        candidates = [np.empty((0, 3))]
        lows = [np.empty((0, 3))]
        are_open = [np.empty(0, bool)]
        for points_m in tiles_m:
            candidates.append(_candidates(points_m))
            tile_lows_m, is_open = _columns(points_m)
            lows.append(tile_lows_m)
            are_open.append(is_open)
        ground = cls._through(np.concatenate(candidates))
        share = ground._share_shown(np.concatenate(lows), np.concatenate(are_open))
        if cut_m is None and share > GROUND_SHARE:
            return ground
        ground.planes[..., 0] -= USUAL_CUT_M if cut_m is None else cut_m
        return replace(ground, has_ground=False)

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

    @classmethod
    def _through(cls, candidates_m: NDArray[np.float64]) -> Self:
        """The planes through candidates (n, 3), at most one in each cell."""
        if not len(candidates_m):
            return cls(np.zeros(2), np.full((1, 1, 3), np.nan), True)
        cell = np.floor(candidates_m[:, :2] / CELL_M).astype(np.int64)
        low = cell.min(axis=0) - REACH_CELLS
        shape = cell.max(axis=0) - low + REACH_CELLS + 1
        in_cell_m = np.full((*shape, 3), np.nan)
        middles_m = (cell + 0.5) * CELL_M
        in_cell_m[tuple((cell - low).T)] = candidates_m - np.pad(middles_m, [(0, 0), (0, 1)])
        return cls(low * CELL_M, _planes(in_cell_m), True)

    def _share_shown(self, lows_m: NDArray[np.float64], is_open: NDArray[np.bool_]) -> float:
        """The share of columns that show the ground, in the median over the cells.

        Columns are given by their lowest points (n, 3), and whether nothing stands just above.
        """
        is_known = np.isfinite(self.heights_m(lows_m[:, :2]))
        if not is_known.any():
            return 0.0
        cell = np.floor((lows_m[is_known, :2] - self.corner_m) / CELL_M).astype(np.int64)
        number = cell @ (self.planes.shape[1], 1)
        columns = np.bincount(number)
        shown = np.bincount(number, self._are_shown(lows_m, is_open)[is_known])
        is_cell = columns >= FEWEST_POINTS
        return float(np.median(shown[is_cell] / columns[is_cell])) if is_cell.any() else 0.0

    def _are_shown(
        self, lows_m: NDArray[np.float64], is_open: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Whether columns (n,) show the ground, as of `_share_shown`."""
        off_m = lows_m[:, 2] - self.heights_m(lows_m[:, :2])
        return (np.abs(off_m) < NEAR_GROUND_M) & is_open

    def _planes_at(
        self, xy_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The plane (n, 3) at positions (n, 2), and their offsets (n, 2) from its cell's centre."""
        cell = np.floor((xy_m - self.corner_m) / CELL_M).astype(np.int64)
        is_inside = ((cell >= 0) & (cell < self.planes.shape[:2])).all(axis=1)
        planes = np.full((len(xy_m), 3), np.nan)
        planes[is_inside] = self.planes[tuple(cell[is_inside].T)]
        return planes, xy_m - (self.corner_m + (cell + 0.5) * CELL_M)


def columns_with_ground(points_m: NDArray[np.float64]) -> int:
    """The number of columns of a map's points (n, 3), in metres, that show a ground."""
    return int(LocalGround._through(_candidates(points_m))._are_shown(*_columns(points_m)).sum())


def _candidates(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The candidate (c, 3) of each cell with enough points (n, 3)."""
    cell = np.floor(points_m[:, :2] / CELL_M).astype(np.int64)
    order = np.lexsort((points_m[:, 2], cell[:, 1], cell[:, 0]))
    cell = cell[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)])
    counts = np.diff(np.r_[starts, len(cell)])
    lowest = starts + (counts * LOWEST_SHARE).astype(np.int64)
    return np.asarray(points_m[order[lowest[counts >= FEWEST_POINTS]]])


def _columns(
    points_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The lowest point (c, 3) of each column with points (n, 3), and whether nothing stands just
    above it (c,)."""
    column = np.floor(points_m[:, :2] / COLUMN_M).astype(np.int64)
    order = np.lexsort((points_m[:, 2], column[:, 1], column[:, 0]))
    column = column[order]
    points_m = points_m[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(column, axis=0) != 0).any(axis=1)])
    counts = np.diff(np.r_[starts, len(column)])
    above_m = points_m[:, 2] - np.repeat(points_m[starts, 2], counts)
    stands = (above_m > NEAR_GROUND_M) & (above_m < OPEN_M)
    return points_m[starts], ~np.logical_or.reduceat(stands, starts)


@njit(cache=True, nogil=True, error_model="numpy")
def _planes(candidates_m):  # type: ignore[no-untyped-def]
    """The plane (x, y, 3) around each cell of candidates (x, y, 3), each from the centre of its own
    cell, by reweighted least squares."""
    x_count, y_count, _ = candidates_m.shape
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
                    if np.isfinite(candidates_m[a, b, 2]):
                        x_m[count] = (a - i) * CELL_M + candidates_m[a, b, 0]
                        y_m[count] = (b - j) * CELL_M + candidates_m[a, b, 1]
                        z_m[count] = candidates_m[a, b, 2]
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
