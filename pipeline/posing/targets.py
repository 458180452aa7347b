"""Targets: the thinned training submaps that queries are registered against (METHODS 9.1).

`write_map` thins the submaps of a training sequence and writes them as a map artifact. `Targets`
reads this artifact, prepares submaps for registration when they are first needed, and chooses the
candidates for a query: the submaps that a ranking points to, or whose walls look like the query's.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.frames import Poses
from pipeline.mapping.gathering import submap_points
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.mapping.wall_chart import Chart
from pipeline.posing.registration import Cloud, Points, Registration
from pipeline.posing.verification import Seen
from pipeline.posing.walls import Walls

APART_M = 5.0
"""A candidate nearer than this to an earlier one is skipped."""
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

    def similar(self, walls: Walls, walls_m: Points, left_out: NDArray[np.bool_]) -> Iterator[int]:
        """The rows not `left_out` (row,), those first whose walls fit a query's (n, 3) best."""
        cells_at_headings = walls.cells_at_headings(walls_m)
        rows = list(self.spaced(np.flatnonzero(~left_out)))
        scores = [walls.match(self.chart(walls, row), cells_at_headings).score for row in rows]
        best_first = sorted(range(len(rows)), key=lambda i: -scores[i])
        yield from (rows[i] for i in best_first)

    def spaced(self, rows: Iterable[int]) -> Iterator[int]:
        """The rows whose anchors are at least APART_M from those of all rows chosen before."""
        anchors_m = self.world_T_anchor[:, :2, 3]
        chosen_m = np.full((len(self.world_T_anchor), 2), np.inf)
        for row in rows:
            if np.linalg.norm(chosen_m - anchors_m[row], axis=1).min() >= APART_M:
                chosen_m[row] = anchors_m[row]
                yield row
