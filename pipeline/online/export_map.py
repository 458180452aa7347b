"""Exports a site's map: a point cloud of a site of 3-D scans, a Nav2 map of a level site.

It is in the site's world. The submaps of a drive overlap, so their points are thinned together: a
place that a hundred submaps show has one point a voxel.
"""

from pathlib import Path

import numpy as np

from pipeline.core.errors import ArtifactError, ConfigError, InputError
from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.formats import nav2_map
from pipeline.mapping.map_output import MapOutput
from pipeline.mapping.tiled_map import Thinning, TiledMap
from pipeline.online import site_file
from pipeline.online.site_file import LevelParts, Parts
from pipeline.opening.map_files import SIMULATED
from pipeline.posing.map_day import VOXEL_M
from pipeline.posing.targets import Targets

NAV2_SUFFIXES = (".yaml", ".yml")


def export_map(source: Path, out: str, progress: Progress) -> tuple[list[str], bool]:
    """Write the map of the site `source` as FILE.pcd, FILE.ply, a folder of tiles or FILE.yaml.

    Returns lines on what was written, and whether the site is simulated, which the files say too.
    Raises ConfigError for an ending that does not fit the site, ArtifactError for a site whose
    parts do not fit together.
    """
    parts = site_file.read_either(source)
    is_simulated = parts.description.simulated
    comment = SIMULATED if is_simulated else ""
    is_nav2 = Path(out).suffix in NAV2_SUFFIXES
    if isinstance(parts, LevelParts) != is_nav2:
        kind, expected = ("3-D scans", "FILE.pcd, FILE.ply or FOLDER/")
        if not is_nav2:
            kind, expected = ("a level laser", "a Nav2 map, FILE.yaml")
        raise ConfigError(f"-o {out}: the map of a site of {kind} is {expected}")
    try:
        if isinstance(parts, LevelParts):
            return [_write_nav2(parts, Path(out), comment)], is_simulated
        tiled = world_map(parts, progress)
    except (KeyError, ValueError, IndexError, TypeError, InputError) as error:
        raise ArtifactError(
            f"{source}: its parts do not fit together ({error}); pack the site again"
        ) from None
    return MapOutput.of(out).write(tiled, comment), is_simulated


def world_map(parts: Parts, progress: Progress) -> TiledMap:
    """The points of a site in its world: its tiles, or its submaps thinned together.

    Raises InputError for a site without points.
    """
    settings = parts.description.map
    if settings.is_tiled:
        return TiledMap.of_arrays(parts.arrays)
    submaps = Targets(parts.arrays, settings.grain_m, settings.range_m, settings.single)
    count = len(submaps.world_T_anchor)
    thinning = Thinning(VOXEL_M)
    for row in progress.track(range(count), count, "join the submaps"):
        world_m = transformed(submaps.world_T_anchor[row], submaps.points_m(row))
        thinning.add(world_m[np.isfinite(world_m).all(axis=1)])
    return thinning.tiled()


def _write_nav2(parts: LevelParts, path: Path, comment: str) -> str:
    """Write a level site's map; returns a line on it."""
    level = parts.description.level
    occupancy = parts.arrays["occupancy"]
    x_m, y_m, yaw_rad = level.origin
    grid = nav2_map.GridMap(occupancy, level.cell_m, (x_m, y_m, yaw_rad))
    nav2_map.write(path, grid, comment)
    rows, cols = occupancy.shape
    image = path.with_suffix(".pgm").name
    return f"{path}: {cols} x {rows} cells of {level.cell_m:g} m, in {image} beside it"
