"""A 3-D map in tiles: the points of any number of files in, thinned points by place out.

`Thinning` takes the points block by block, so the files may be larger than the memory. It keeps the
mean of the points of each voxel. A `TiledMap` holds these means, tile by tile, as whole multiples
of GRAIN_M from the corner of their tile, so coordinates of a country's grid lose nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

Points = NDArray[np.float64]
"""(n, 3) in metres."""
TILE_M = 50.0
"""Side of a tile."""
GRAIN_M = 0.01
"""Points are stored as whole multiples of this."""
FULL = 400_000
"""Voxels of a column of tiles are joined as soon as this many are waiting."""
CELL_BITS = 20
MOST_CELLS = 2**CELL_BITS
"""Voxels along each axis, half of them to each side of the first point."""
HIGHEST_M = GRAIN_M * np.iinfo(np.int16).max
"""Points farther above or below the middle height of their tile are left out."""
FEWEST_VOXELS = 20
"""A tile with fewer voxels holds stray points; it is left out."""
WIDEST_M2 = 4e8
"""A map with a larger box has stray points, or should be packed in parts."""
SPARSE_M2 = 200.0
"""A map whose points are all within so small an area is of an object."""
ARRAYS = ("points", "offsets", "tile_corner_m")
"""Names of the arrays of a map in a site file."""


@dataclass(frozen=True)
class TiledMap:
    """The thinned points of a map, tile by tile."""

    points: NDArray[np.int16]
    """(n, 3) in units of GRAIN_M, from the corner of their tile."""
    offsets: NDArray[np.int64]
    """(tile + 1,) the points of tile i are points[offsets[i] : offsets[i + 1]]."""
    tile_corner_m: NDArray[np.float64]
    """(tile, 3) the lower corner of each tile along x and y, and a height near its points."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The map of a site file's arrays; raises ValueError for shapes that do not fit."""
        points, offsets, corner_m = (np.asarray(arrays[name]) for name in ARRAYS)
        is_whole = (
            points.ndim == 2
            and points.shape[1:] == (3,)
            and offsets.shape == (len(corner_m) + 1,)
            and corner_m.shape[1:] == (3,)
            and (np.diff(offsets) >= 0).all()
            and offsets[0] == 0
            and offsets[-1] == len(points)
            and np.isfinite(corner_m).all()
        )
        if not is_whole:
            raise ValueError(f"points {points.shape}, offsets {offsets.shape}")
        return cls(points, offsets, corner_m)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that a site file keeps."""
        return {name: getattr(self, name) for name in ARRAYS}

    def without_strays(self, fewest: int = FEWEST_VOXELS) -> "tuple[TiledMap, int]":
        """The map without tiles of fewer than `fewest` points, and how many points these have."""
        counts = np.diff(self.offsets)
        is_kept = counts >= fewest
        if is_kept.all():
            return self, 0
        is_kept_point = np.repeat(is_kept, counts)
        offsets = np.r_[0, np.cumsum(counts[is_kept])]
        kept = TiledMap(self.points[is_kept_point], offsets, self.tile_corner_m[is_kept])
        return kept, int((~is_kept_point).sum())

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The least and the largest x, y, z (3,) of all points."""
        low = np.minimum.reduceat(self.points, self.offsets[:-1], axis=0)
        high = np.maximum.reduceat(self.points, self.offsets[:-1], axis=0)
        low_m = (low * GRAIN_M + self.tile_corner_m).min(axis=0)
        return low_m, (high * GRAIN_M + self.tile_corner_m).max(axis=0)

    @property
    def unfit(self) -> str:
        """Why a map of this size is not packed, and what to do; empty if it is."""
        if not len(self):
            return f"its points are strays, fewer than {FEWEST_VOXELS} in each tile"
        low_m, high_m = self.box_m
        x_m, y_m, _ = high_m - low_m
        if x_m * y_m > WIDEST_M2:
            return (
                f"its box is {x_m / 1e3:.0f} × {y_m / 1e3:.0f} km: remove stray points, or pack "
                "the map in parts"
            )
        if x_m * y_m < SPARSE_M2:
            return (
                f"its points lie within {x_m:.0f} × {y_m:.0f} m, as of an object; expected a map "
                "of a place"
            )
        return ""

    def __len__(self) -> int:
        """The number of tiles."""
        return len(self.tile_corner_m)

    def tile_m(self, tile: int) -> Points:
        """The points (n, 3) of one tile, in the map's frame."""
        grains = self.points[self.offsets[tile] : self.offsets[tile + 1]]
        return np.asarray(grains * GRAIN_M + self.tile_corner_m[tile])

    def tiles_m(self) -> Iterator[Points]:
        """The points (n, 3) of each tile, in the map's frame."""
        return map(self.tile_m, range(len(self)))

    def around(self, xy_m: NDArray[np.float64], range_m: float) -> Points:
        """The points (n, 3) nearer than `range_m` to a position (2,), seen from above."""
        low = np.floor((xy_m - range_m) / TILE_M).astype(np.int64)
        high = np.floor((xy_m + range_m) / TILE_M).astype(np.int64)
        parts = [np.empty((0, 3))]
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                if (tile := self._tile_of.get((x, y))) is not None:
                    parts.append(self.tile_m(tile))
        points_m = np.concatenate(parts)
        offset_m = points_m[:, :2] - xy_m
        return points_m[np.hypot(offset_m[:, 0], offset_m[:, 1]) < range_m]

    @cached_property
    def _tile_of(self) -> dict[tuple[int, int], int]:
        """The number of each tile, by its position in whole tiles."""
        positions = np.rint(self.tile_corner_m[:, :2] / TILE_M).astype(np.int64)
        return {(x, y): tile for tile, (x, y) in enumerate(positions.tolist())}


class Thinning:
    """Thins the points of a map to the mean of each voxel, block by block."""

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._first_cell: NDArray[np.int64] | None = None
        self._slabs: dict[int, list[_Voxels]] = {}
        """The voxels of each column of tiles: joined ones first, then those that wait for it."""

    def add(self, points_m: Points) -> None:
        """Add finite points (n, 3), in the map's frame.

        Raises InputError for points some hundred kilometres from the first ones.
        """
        if not len(points_m):
            return
        cells = np.floor(points_m / self._voxel_m).astype(np.int64)
        if self._first_cell is None:
            self._first_cell = cells[0] - MOST_CELLS // 2
        steps = cells - self._first_cell
        is_far = ((steps < 0) | (steps >= MOST_CELLS)).any(axis=1)
        if is_far.any():
            position = ", ".join(f"{value:.0f}" for value in points_m[is_far][0])
            raise InputError(f"a point at {position} m is far from all others: remove stray points")
        x, y, z = steps.T
        within_m = (points_m - cells * self._voxel_m).astype(np.float32)
        key = (x << (2 * CELL_BITS)) + (y << CELL_BITS) + z
        voxels = _Voxels.summed(key, within_m, np.ones(len(key), np.int32))
        slab, _ = self._tiles(voxels.key)  # ascending, as the keys are
        starts = np.flatnonzero(np.r_[True, slab[1:] != slab[:-1]])
        for start, end in zip(starts, [*starts[1:], len(slab)], strict=True):
            waiting = self._slabs.setdefault(int(slab[start]), [])
            waiting.append(voxels.part(int(start), int(end)))
            if sum(len(part.key) for part in waiting[1:]) > FULL:
                waiting[:] = [_Voxels.joined(waiting)]

    def tiled(self) -> TiledMap:
        """The map of all points so far; raises InputError if there are none."""
        if self._first_cell is None:
            raise InputError("a map without points")
        parts: list[NDArray[np.int16]] = []
        corners_m: list[tuple[float, float, float]] = []
        for slab in sorted(self._slabs):
            key, sum_m, points = _Voxels.joined(self._slabs.pop(slab))
            _, tile_y = self._tiles(key)
            order = np.argsort(tile_y, kind="stable")
            starts = np.flatnonzero(np.r_[True, np.diff(tile_y[order]) != 0])
            for rows in np.split(order, starts[1:]):
                cells = np.column_stack(np.unravel_index(key[rows], (MOST_CELLS,) * 3))
                low_m = (cells + self._first_cell) * self._voxel_m
                means_m = low_m + sum_m[rows] / points[rows, None]
                middle_m = float(np.rint(np.median(means_m[:, 2])))
                corner_m = (slab * TILE_M, int(tile_y[rows[0]]) * TILE_M, middle_m)
                grains = np.rint((means_m - corner_m) / GRAIN_M)
                is_near = np.abs(grains[:, 2]) < HIGHEST_M / GRAIN_M
                parts.append(grains[is_near].astype(np.int16))
                corners_m.append(corner_m)
        offsets = np.r_[0, np.cumsum([len(part) for part in parts])]
        return TiledMap(np.concatenate(parts), offsets, np.array(corners_m))

    def _tiles(self, key: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The tile (n,) along x, and along y, of voxels (n,) given by their keys."""
        assert self._first_cell is not None
        x, y, _ = np.unravel_index(key, (MOST_CELLS,) * 3)
        first_x, first_y, _ = self._first_cell
        scale = self._voxel_m / TILE_M
        tile_x = np.floor((x + first_x + 0.5) * scale).astype(np.int64)
        return tile_x, np.floor((y + first_y + 0.5) * scale).astype(np.int64)


class _Voxels(NamedTuple):
    """Sums of points by voxel, each voxel once."""

    key: NDArray[np.int64]
    """(n,) the position of each voxel, as one number."""
    sum_m: NDArray[np.float32]
    """(n, 3) the sum of its points, from the voxel's lower corner."""
    points: NDArray[np.int32]
    """(n,) the number of its points."""

    def part(self, start: int, end: int) -> "_Voxels":
        """The rows from `start` to `end`."""
        return _Voxels(self.key[start:end], self.sum_m[start:end], self.points[start:end])

    @classmethod
    def joined(cls, parts: "Sequence[_Voxels]") -> "_Voxels":
        """The sums of several parts, in which a voxel may occur several times."""
        return cls.summed(*map(np.concatenate, zip(*parts, strict=True)))

    @classmethod
    def summed(
        cls, key: NDArray[np.int64], sum_m: NDArray[np.float32], points: NDArray[np.int32]
    ) -> "_Voxels":
        """The sums of rows of which several may be of one voxel."""
        order = np.argsort(key, kind="stable")
        key = key[order]
        starts = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
        sums = [np.add.reduceat(sum_m[order, axis], starts) for axis in range(3)]
        return cls(key[starts], np.column_stack(sums), np.add.reduceat(points[order], starts))
