"""Level maps: which cells of a building are walls, free, or unknown to a level laser.

`Drawing` makes a `LevelMap` from sweeps with poses, by the counting model of METHODS 13.1;
formats/nav2_map.py reads one from a map in Nav2's format.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import transformed

UNKNOWN = -1
FREE = 0
OCCUPIED = 100
"""Values of a drawn cell; maps of other programs have any percentage from FREE to OCCUPIED."""
WALL_PERCENT = 50
"""A cell is a wall if it is occupied with this probability or a higher one."""
FINEST_M = 0.01
COARSEST_M = 0.5
MOST_CELLS = 50_000_000
"""A map with smaller, larger or more cells is refused."""
FINE_M = 0.05
COARSE_M = 0.1
LARGE_M2 = 12_500.0
"""Maps are drawn in cells of FINE_M, or of COARSE_M if the box around the sweeps is larger than
this."""
LEAST_SHARE = 0.25
"""A cell is a wall if at least this share of the beams that reached it ended there (gmapping's
threshold)."""


@dataclass(frozen=True)
class LevelMap:
    """An occupancy grid in the convention of ROS: row 0 is the lowest, column 0 the leftmost."""

    occupancy: NDArray[np.int8]
    """(row, col) probability in percent that a cell is occupied; UNKNOWN where no beam reached."""
    cell_m: float
    """Side of a cell."""
    origin: tuple[float, float, float]
    """x, y in metres and yaw in radians, in the world, of the outer corner of cell (0, 0)."""

    def __post_init__(self) -> None:
        """Raise InputError for a grid that cannot be the map of a building."""
        if not FINEST_M <= self.cell_m <= COARSEST_M:
            raise InputError(
                f"a map with cells of {self.cell_m:g} m: expected {FINEST_M:g} to {COARSEST_M:g} "
                "m; is the resolution given in metres?"
            )
        if not np.isfinite(self.origin).all():
            raise InputError(f"a map with the origin {self.origin}: expected finite x, y and yaw")
        if self.occupancy.ndim != 2 or not 0 < self.occupancy.size <= MOST_CELLS:
            raise InputError(
                f"a map of {' x '.join(map(str, self.occupancy.shape))} cells: expected 1 to "
                f"{MOST_CELLS:,}; choose larger cells"
            )
        if not self.walls.any():
            raise InputError("a map without walls: expected some occupied cells")
        if not self.free.any():
            raise InputError("a map without free space: expected cells where a robot can stand")

    @property
    def walls(self) -> NDArray[np.bool_]:
        """(row, col) which cells are walls."""
        return np.asarray(self.occupancy >= WALL_PERCENT)

    @property
    def free(self) -> NDArray[np.bool_]:
        """(row, col) which cells are known to be free of walls."""
        return np.asarray((self.occupancy >= 0) & (self.occupancy < WALL_PERCENT))

    @property
    def world_T_grid(self) -> NDArray[np.float64]:
        """(4, 4) pose of the outer corner of cell (0, 0): x along columns, y along rows."""
        x_m, y_m, yaw_rad = self.origin
        pose = np.eye(4)
        pose[:2, :2] = [
            [np.cos(yaw_rad), -np.sin(yaw_rad)],
            [np.sin(yaw_rad), np.cos(yaw_rad)],
        ]
        pose[:2, 3] = x_m, y_m
        return pose

    @property
    def free_m2(self) -> float:
        """The free area in square metres."""
        return float(self.free.sum()) * self.cell_m**2


@dataclass(frozen=True)
class Drawing:
    """The beams of all sweeps, counted in each cell of a grid.

    From the counts a map is drawn of all sweeps, or without some sweeps, which are subtracted.
    """

    starts: NDArray[np.float64]
    """(beam, 2) x, y in cells, from the outer corner of cell (0, 0)."""
    ends: NDArray[np.float64]
    """(beam, 2) x, y in cells, from the same corner."""
    is_hit: NDArray[np.bool_]
    """(beam,) True if the beam ends at an object, False if it is cut off at the range."""
    sweep: NDArray[np.int64]
    """(beam,) the number of its sweep."""
    hits: NDArray[np.int32]
    """(row, col) the number of beams that end at an object in each cell."""
    passes: NDArray[np.int32]
    """(row, col) the number of beams that pass through each cell."""
    cell_m: float
    """Side of a cell."""
    origin: tuple[float, float, float]
    """The origin of the LevelMap that is drawn."""

    @classmethod
    def of(
        cls,
        sweeps_m: Sequence[NDArray[np.floating]],
        world_T_sweep: NDArray[np.float64],
        cell_m: float | None = None,
        range_m: float = 30.0,
    ) -> Self:
        """Count the beams of s sweeps, whose hits (n, 2 or 3) are in the frames of their poses.

        The poses are (s, 4, 4). A beam longer than `range_m` is cut off there and hits nothing.
        Without `cell_m` the size of the cells depends on the area of the sweeps. Raises InputError
        if no hit is within range, or if the grid would be too large.
        """
        ends_of_sweeps = [
            transformed(pose, _finite(sweep)[:, :2])
            for sweep, pose in zip(sweeps_m, world_T_sweep, strict=True)
        ]
        sweep = np.arange(len(ends_of_sweeps)).repeat([len(ends) for ends in ends_of_sweeps])
        ends_m = np.concatenate([np.empty((0, 2)), *ends_of_sweeps])
        starts_m = world_T_sweep[:, :2, 3][sweep]

        # cut off the beams that are too long
        length_m = np.linalg.norm(ends_m - starts_m, axis=1)
        is_hit = length_m <= range_m
        if not is_hit.any():
            raise InputError(f"no sweep has a hit within {range_m:g} m: they make no map")
        share = np.minimum(1, range_m / np.maximum(length_m, 1e-9))
        ends_m = starts_m + (ends_m - starts_m) * share[:, None]

        # place a grid of whole cells over all beams, with a margin of one cell
        corners_m = np.stack([starts_m, ends_m])
        if cell_m is None:
            area_m2 = float(np.prod(np.ptp(corners_m.reshape(-1, 2), axis=0)))
            cell_m = FINE_M if area_m2 <= LARGE_M2 else COARSE_M
        lowest = np.floor(corners_m.min(axis=(0, 1)) / cell_m - 1)
        highest = np.ceil(corners_m.max(axis=(0, 1)) / cell_m + 1)
        cols, rows = (highest - lowest).astype(int).tolist()
        if rows * cols > MOST_CELLS:
            raise InputError(
                f"sweeps over {rows * cell_m:.0f} x {cols * cell_m:.0f} m make more than "
                f"{MOST_CELLS:,} cells of {cell_m:g} m; choose larger cells"
            )

        hits = np.zeros((rows, cols), np.int32)
        passes = np.zeros((rows, cols), np.int32)
        starts = starts_m / cell_m - lowest
        ends = ends_m / cell_m - lowest
        _count(starts, ends, is_hit, hits, passes, 1)
        x_m, y_m = (lowest * cell_m).tolist()
        return cls(starts, ends, is_hit, sweep, hits, passes, cell_m, (x_m, y_m, 0.0))

    def level_map(self, left_out: NDArray[np.bool_] | None = None) -> LevelMap:
        """Draw the map, without the sweeps that are True in `left_out` (s,).

        A cell is a wall if at least LEAST_SHARE of the beams that reached it ended there, and free
        if fewer did (counting model; Hähnel et al., IROS 2003). Raises InputError if the map would
        have no wall or no free cell.
        """
        hits = self.hits
        passes = self.passes
        if left_out is not None:
            hits = hits.copy()
            passes = passes.copy()
            beams = left_out[self.sweep]
            _count(self.starts[beams], self.ends[beams], self.is_hit[beams], hits, passes, -1)
        reached = hits + passes
        occupancy = np.full(hits.shape, UNKNOWN, np.int8)
        occupancy[reached > 0] = FREE
        occupancy[(hits > 0) & (hits >= LEAST_SHARE * reached)] = OCCUPIED
        return LevelMap(occupancy, self.cell_m, self.origin)


def _finite(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The points (n, 2 or 3) that are finite."""
    points_m = np.asarray(points_m, np.float64)
    return np.asarray(points_m[np.isfinite(points_m).all(axis=1)])


@njit(cache=True, nogil=True)
def _count(starts, ends, is_hit, hits, passes, by):  # type: ignore[no-untyped-def]
    """Add `by`, which is 1 or −1, to `hits` and `passes` (row, col) for each beam, in place.

    Starts and ends of beams (n, 2) are x, y in cells. A beam passes each cell once, and does not
    pass the cell that it ends in.
    """
    for beam in range(len(starts)):
        x0 = starts[beam, 0]
        y0 = starts[beam, 1]
        x1 = ends[beam, 0]
        y1 = ends[beam, 1]
        end_col = int(x1)
        end_row = int(y1)
        steps = int(max(abs(x1 - x0), abs(y1 - y0))) + 1
        last_col = -1
        last_row = -1
        for step in range(steps):
            share = step / steps
            col = int(x0 + share * (x1 - x0))
            row = int(y0 + share * (y1 - y0))
            if (col == end_col and row == end_row) or (col == last_col and row == last_row):
                continue
            passes[row, col] += by
            last_col = col
            last_row = row
        if is_hit[beam]:
            hits[end_row, end_col] += by
