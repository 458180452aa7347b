"""Targets: the thinned training submaps that queries are registered against (METHODS 9.1).

`write_map` thins the submaps of a training sequence and writes them as a map artifact. `Targets`
reads this artifact, prepares submaps for registration when they are first needed, and chooses the
candidates for a query: the submaps that a ranking points to.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.frames import Poses, pose, yaw
from pipeline.mapping.gathering import submap_points
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.mapping.wall_chart import Chart
from pipeline.matching.correlation import DRAWN, WallMap
from pipeline.posing.registration import Cloud, Points, Registration
from pipeline.posing.verification import Seen
from pipeline.posing.walls import Walls
from pipeline.posing.whole_map import WholeMap

APART_M = 5.0
"""A candidate nearer than this to an earlier one is skipped."""
CACHED_MAPS = 2
"""Number of drawn maps of walls kept in memory, each without other rows."""
CACHED_CLOUDS = 256
"""Number of prepared clouds kept in memory: some 400 MB for submaps of several scans. Charts are
small, and all of them are kept."""


def write_map(
    path: Path,
    scans: schemas.Scans,
    submaps: schemas.Submaps,
    voxel_m: float,
    range_m: float,
    gathered_m: float,
) -> tuple[int, int]:
    """Thin the submaps of a training sequence to one point a voxel, and write them as a map.

    Points farther from the anchor than `range_m` are left out; in submaps of several scans, points
    farther than `gathered_m`. Returns the numbers of submaps and of points.
    """
    world_T_anchor = submaps.load("world_T_anchor")
    offsets = [0]
    # A submap is a single scan if its first scan is its anchor.
    is_single_scan = bool((submaps.load("first") == submaps.load("scans")).all())
    range_m = range_m if is_single_scan else gathered_m
    attrs = {"grain_m": GRAIN_M, "voxel_m": voxel_m, "range_m": range_m, "single": is_single_scan}
    with store.draft(path, schemas.Maps, **attrs) as out:
        for points_m in submap_points(scans, submaps, slice(0, len(world_T_anchor))):
            points = thinned(points_m, range_m, voxel_m)
            out.append("points", points)
            offsets.append(offsets[-1] + len(points))
        out.put("offsets", np.array(offsets))
        out.put("world_T_anchor", world_T_anchor)
    return len(world_T_anchor), offsets[-1]


def thinned(points_m: Points, range_m: float, voxel_m: float) -> NDArray[np.int64]:
    """The points (n, 3) within `range_m`, thinned to one a voxel, in units of GRAIN_M."""
    sampled = small_gicp.voxelgrid_sampling(within_range(points_m, range_m), voxel_m)
    xyz_m = np.asarray(sampled.points())[:, :3]
    return np.rint(xyz_m / GRAIN_M).astype(np.int64)


def within_range(points_m: Points, range_m: float) -> Points:
    """The points (n, 3) within `range_m` of the anchor, seen from above.

    Points that are not finite are kept, so that registration refuses them.
    """
    return points_m[~(np.hypot(points_m[:, 0], points_m[:, 1]) >= range_m)]


class Targets:
    """The training submaps of a map, one a row.

    - `world_T_anchor` (row, 4, 4): their poses.
    - `single`: whether each is a single scan.
    - `range_m`: largest distance of a point from the anchor.
    - `chart(walls, row)`, `cloud(registration, row)`, `seen(registration, walls, row)`: a submap's
      walls from above, its cloud prepared for registration, and both together; they are cached.
    """

    is_map: bool = False
    """Whether the rows are cut-outs of one map, of which none knows more than its neighbours."""

    def __init__(
        self,
        arrays: Mapping[str, NDArray[Any]],
        grain_m: float,
        range_m: float,
        single: bool,
        cached_clouds: int = CACHED_CLOUDS,
    ) -> None:
        """Build them from the columns and attributes of a map artifact (schemas.Maps)."""
        self._arrays = arrays
        self._grain_m = grain_m
        self.single = single
        self.range_m = range_m
        self.world_T_anchor: Poses = arrays["world_T_anchor"]
        self._wall_cells: Callable[[WholeMap, int], NDArray[np.int64]] = lru_cache(None)(
            self._drawn_cells
        )
        self._wall_map: Callable[[WholeMap, bytes], WallMap] = lru_cache(CACHED_MAPS)(self._drawn)
        self.chart: Callable[[Walls, int], Chart] = lru_cache(None)(self._chart)
        self.seen: Callable[[Registration, Walls, int], Seen] = lru_cache(cached_clouds)(self._seen)
        self.cloud: Callable[[Registration, int], Cloud] = lru_cache(cached_clouds)(self._cloud)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the targets of a map artifact; raises ArtifactError if there is none."""
        artifact = store.read(path, schemas.Maps)
        attrs = {name: artifact.attrs[name] for name in ("grain_m", "range_m", "single")}
        return cls({name: artifact.load(name) for name in schemas.Maps.columns}, **attrs)

    def _chart(self, walls: Walls, row: int) -> Chart:
        """The chart of a row's walls from above."""
        return walls.chart(walls.of(self.points_m(row)), self.single)

    def _cloud(self, registration: Registration, row: int) -> Cloud:
        """A row's points, prepared for registration."""
        return registration.prepare(self.points_m(row))

    def _seen(self, registration: Registration, walls: Walls, row: int) -> Seen:
        """What a row's sensor hit and saw through."""
        return Seen.of(walls, self.cloud(registration, row), self.chart(walls, row))

    def points_m(self, row: int) -> Points:
        """The thinned points (n, 3) of a row, in its anchor's frame, z up from the ground."""
        offsets = self._arrays["offsets"]
        points = self._arrays["points"][offsets[row] : offsets[row + 1]]
        return np.asarray(points * self._grain_m)

    def nearest(self, xy_m: NDArray[np.float64], left_out: NDArray[np.bool_]) -> Iterator[int]:
        """For each of some positions (n, 2), the row with the nearest anchor.

        Rows that are True in `left_out` (row,) are ignored, and so are positions that are not
        finite.
        """
        anchors_m = np.where(left_out[:, None], np.inf, self.world_T_anchor[:, :2, 3])
        if not left_out.all():
            finite_xy_m = xy_m[np.isfinite(xy_m).all(axis=1)]
            yield from (
                np.linalg.norm(anchors_m - finite_xy_m[:, None], axis=2).argmin(axis=1).tolist()
            )

    def guesses(
        self,
        xy_m: NDArray[np.float64],
        heading_deg: NDArray[np.float64],
        left_out: NDArray[np.bool_],
        reach_m: float = np.inf,
    ) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """For each of some positions (n, 2) with headings (n,), a row and a pose in its frame.

        It is the nearest row, and the pose (4, 4) there; a position farther than `reach_m` from its
        anchor, along x or y, is moved to the anchor. There is none for a position or a heading that
        is not finite, or if all rows are `left_out` (row,).
        """
        for position_m, heading in zip(xy_m, heading_deg, strict=True):
            if not np.isfinite([*position_m, heading]).all():
                continue
            # The nearest row: a single one, or none if all are left out.
            for row in self.nearest(position_m[None], left_out):
                world_T_anchor = self.world_T_anchor[row]
                # The heading and position in the frame of that row's anchor.
                turn_rad = np.deg2rad(heading) - yaw(world_T_anchor)
                away_m = np.append(position_m - world_T_anchor[:2, 3], 0.0)
                offset_m = world_T_anchor[:3, :3].T @ away_m
                if (np.abs(offset_m[:2]) > reach_m).any():
                    offset_m = np.zeros(3)  # too far from the anchor to start there
                xyz_m = np.array([[*offset_m[:2], 0.0]])
                yield row, pose(xyz_m, np.array([[0.0, 0.0, turn_rad]]))[0]

    def wall_map(self, whole_map: WholeMap, left_out: NDArray[np.bool_]) -> WallMap:
        """The walls of all rows that are not `left_out` (row,), drawn into one map.

        A site has the map of all rows among its arrays.
        """
        return self._wall_map(whole_map, np.packbits(left_out).tobytes())

    def _drawn(self, whole_map: WholeMap, left_out_bits: bytes) -> WallMap:
        """The walls of all rows whose bit is not set, drawn into one map."""
        bits = np.frombuffer(left_out_bits, np.uint8)
        left_out = np.unpackbits(bits, count=len(self.world_T_anchor)).astype(bool)
        if DRAWN + "counts" in self._arrays and not left_out.any():
            return WallMap.of_arrays(self._arrays, whole_map.view.cell_m)
        rows = np.flatnonzero(~left_out)
        cells = [self._wall_cells(whole_map, row) for row in rows.tolist()]
        return whole_map.drawn(cells, self.world_T_anchor[rows, :2, 3])

    def _drawn_cells(self, whole_map: WholeMap, row: int) -> NDArray[np.int64]:
        """The cells (n, 2) of the world that have walls of a row."""
        return whole_map.wall_cells(self.points_m(row), self.world_T_anchor[row])

    def spaced(self, rows: Iterable[int]) -> Iterator[int]:
        """The rows whose anchors are at least APART_M from those of all rows chosen before."""
        anchors_m = self.world_T_anchor[:, :2, 3]
        chosen_m = np.full((len(self.world_T_anchor), 2), np.inf)
        for row in rows:
            if np.linalg.norm(chosen_m - anchors_m[row], axis=1).min() >= APART_M:
                chosen_m[row] = anchors_m[row]
                yield row
