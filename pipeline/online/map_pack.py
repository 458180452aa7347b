"""Packs a site of a 3-D point-cloud map that somebody has: no drive, and no training (METHODS 15).

1. Thin the map's points to one a voxel, and sort them into tiles.
2. Fit the ground, which is seldom level and often missing.
3. Draw the walls from above: they are the model of the method `bev_correlation`.
4. Set anchors on the ground, wherever the map has points near: a query is registered with the
   points around them.

The verdict has the usual probabilities, since the map has no scans to validate it with:
`yearloc calibrate` learns it from a drive.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.datum import Datum
from pipeline.core.errors import InputError
from pipeline.core.frames import Poses
from pipeline.core.grid import Grid
from pipeline.core.progress import Progress
from pipeline.mapping.anchored_map import NEAR_M, SPACING_M, AnchoredMap
from pipeline.mapping.tiled_map import GRAIN_M, Thinning, TiledMap
from pipeline.matching.database import Database
from pipeline.methods.bev_correlation import BevCorrelation
from pipeline.online import site_file
from pipeline.online.level_pack import LEVEL_VERSIONS
from pipeline.online.sensor import typical
from pipeline.online.site_file import Parts
from pipeline.online.site_json import MapSettings, Provenance, Sensor, Settings, SiteDescription
from pipeline.opening.map_files import FARTHEST_M, MapFiles
from pipeline.posing.expectations import Expectations
from pipeline.posing.map_day import RANGE_M, VOXEL_M, drawn_walls
from pipeline.posing.map_verdict import NOT_CALIBRATED, ROUNDS, WALLS_M, usual_verdict

PLACE_M = 10.0
"""Side of a place."""
K = 25
"""Number of positions that the search ranks."""
COARSEST_M = 0.02
"""Coordinates in larger steps are told to the user."""
METHOD = "pipeline.methods.bev_correlation.BevCorrelation"
VIEW = "pipeline.views.walls.Walls"
FIXER: Settings = {
    "_target_": "pipeline.posing.search.Fixer",
    "walls": {"_target_": "pipeline.posing.walls.Walls", "range_m": WALLS_M},
    "rounds": ROUNDS,
}
READER: Settings = {"_target_": "pipeline.readers.folder.Folder"}
"""The reader of logs that are localised in it; bags and folders of scans need none."""
MAP_VERSIONS = (*LEVEL_VERSIONS, "small_gicp")
"""Packages whose versions a site records."""


@dataclass(frozen=True)
class MapOptions:
    """What a user may say of a map, if it cannot be found out."""

    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The site's world has its origin at this position of the map's frame."""
    voxel_m: float = VOXEL_M
    like: Sequence[NDArray[np.float64]] = ()
    """Scans (n, 3) of the robot that will localise: its sensor, and the height of a cut ground."""
    datum: Datum | None = None
    """Where the site's origin lies on the Earth; None if it is unknown."""


def pack_map(
    paths: Sequence[Path], out: Path, options: MapOptions, progress: Progress
) -> list[str]:
    """Write the site of a 3-D map; returns lines on the map and on the site.

    Raises LogError for files that are no map, InputError for a map in which nothing can be
    localised.
    """
    files = MapFiles.of(paths)
    thinning = Thinning(options.voxel_m)
    for points_m in files.chunks(progress):
        thinning.add(points_m - options.origin_m)
    parts, lines = parts_of_map(
        thinning.tiled(), f"{files.name}", {"map": files.digest()}, options, progress
    )
    description = replace(parts.description, simulated=files.is_simulated)
    site_file.write(out, parts._replace(description=description))
    size = f"{out.stat().st_size / 1e6:.1f} MB"
    places = len(parts.arrays["cells"])
    return [
        *files.notes,
        *_grain_lines(files.tally.step_m),
        *lines,
        f"{out}: {places:,} places of {PLACE_M:g} m, {size}; target precisions "
        f"{', '.join(map(str, parts.description.verdict.reachable))} by the usual probabilities, "
        f"{NOT_CALIBRATED}: `yearloc calibrate {out} LOG` learns them from a drive",
    ]


def _grain_lines(step_m: float) -> list[str]:
    """A line on coordinates that are too large for their 32-bit floats, if they are."""
    if step_m < COARSEST_M:
        return []
    return [
        f"coordinates: 32-bit floats, in steps of {step_m:g} m so far from the origin: poses are "
        "no finer; export the map with an offset, or as 64-bit floats"
    ]


def parts_of_points(points_m: NDArray[np.floating], name: str, options: MapOptions) -> Parts:
    """The content of the site of a map's points (n, 3), in metres.

    Raises InputError for points of another shape, and for a map in which nothing can be localised.
    """
    points = np.asarray(points_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points of shape {points.shape}: expected (n, 3), in metres")
    thinning = Thinning(options.voxel_m)
    thinning.add(points[(np.abs(points) < FARTHEST_M).all(axis=1)] - options.origin_m)
    parts, _ = parts_of_map(thinning.tiled(), name, {"map": None}, options, Progress())
    return parts


def parts_of_map(
    tiled: TiledMap,
    name: str,
    digests: dict[str, str | None],
    options: MapOptions,
    progress: Progress,
) -> tuple[Parts, list[str]]:
    """The content of the site of a tiled map, and lines on the map."""
    cut_m = _cut_m(options.like)
    anchored = AnchoredMap.of(tiled, name, cut_m, progress, options.origin_m)
    tiled, anchors = anchored.tiled, anchored.world_T_anchor
    drawn = drawn_walls(anchored, name, progress)
    grid, cells, place_of_anchor = _places(anchors)
    database = Database(place_of_anchor, anchors[:, :2, 3], np.zeros(len(anchors)))
    method = BevCorrelation()
    description = SiteDescription(
        name=name,
        simulated=False,
        method={"_target_": METHOD, "cell_m": method.cell_m, "candidates_m": NEAR_M},
        view={"_target_": VIEW},
        fixer=FIXER,
        k=K,
        places=grid,
        map=MapSettings(GRAIN_M, RANGE_M, single=False, voxel_m=options.voxel_m, is_tiled=True),
        verdict=usual_verdict(),
        reader=READER,
        sensor=_sensor(options.like),
        provenance=Provenance.of(name, digests, MAP_VERSIONS),
        datum=options.datum,
    )
    arrays = {
        **tiled.arrays,
        "world_T_anchor": anchors,
        "cells": cells,
        **Expectations().arrays,
    }
    model = {**drawn.arrays, **database.arrays()}
    return Parts(description, model, arrays, None), _lines(anchored)


def _cut_m(like: Sequence[NDArray[np.float64]]) -> float | None:
    """The height at which the robot's scans have their ground cut off; None if they show it.

    The scans are in the vehicle's frame, with the ground at z = 0.
    """
    lowest_m = [float(np.quantile(points_m[:, 2], 0.01)) for points_m in like if len(points_m)]
    if not lowest_m or min(lowest_m) < 0.1:
        return None
    return float(np.median(lowest_m))


def _places(anchors: Poses) -> tuple[Grid, NDArray[np.int64], NDArray[np.int64]]:
    """The grid of places, the cell of each place, and the place of each anchor."""
    xy_m = anchors[:, :2, 3]
    low = np.floor(xy_m.min(axis=0) / PLACE_M) * PLACE_M
    high = (np.floor(xy_m.max(axis=0) / PLACE_M) + 1) * PLACE_M
    grid = Grid(PLACE_M, (float(low[0]), float(high[0])), (float(low[1]), float(high[1])))
    cells, place_of_anchor = np.unique(grid.cell(xy_m), return_inverse=True)
    return grid, cells, place_of_anchor.astype(np.int64)


def _sensor(like: Sequence[NDArray[np.float64]]) -> Sensor:
    """The description of the robot's scans; of nothing, if there are none."""
    if not like:
        return Sensor(0.0, None, None, None, None, None, ())
    return typical(like, 0.0)


def _lines(anchored: AnchoredMap) -> list[str]:
    """Lines for the user on the map."""
    tiled, ground = anchored.tiled, anchored.ground
    low_m, high_m = tiled.box_m
    x_m, y_m, _ = high_m - low_m
    tilt_deg = ground.tilt_deg[np.isfinite(ground.tilt_deg)]
    shown = "in the map" if ground.has_ground else "cut off"
    lines = [
        f"map: {len(tiled.points):,} voxels in {len(tiled)} tiles over {x_m:.0f} × {y_m:.0f} m",
        f"ground: {shown}, {np.median(tilt_deg):.1f}° off level in the median, "
        f"{np.quantile(tilt_deg, 0.99):.1f}° at most",
        f"anchors: {len(anchored.world_T_anchor):,}, one every {SPACING_M:g} m",
    ]
    if anchored.strays:
        lines.append(f"strays: {anchored.strays:,} voxels in nearly empty tiles are left out")
    return lines
