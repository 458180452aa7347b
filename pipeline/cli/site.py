"""`yearloc pack` writes a site file; `yearloc export` writes its map, or a site without torch.

A site is one file with all that it takes to localise in a place: a study's model and map, or the
map of a building for a level laser. An export is a site's map as a point cloud, its network as
ONNX, or a site that answers through ONNX.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import SitePath, only_one
from pipeline.cli.outputs import check_file, check_folder
from pipeline.cli.progress import Bar
from pipeline.cli.project import conf_folder, named_model
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time it would slow the start of every command
    from pipeline.online.map_pack import MapOptions

MOST_LIKE = 10
"""Largest number of scans that tell the sensor."""
LEAST_CELL_M = 0.1
MOST_CELL_M = 1.0
"""Bounds of the distance of the points that a site keeps of a 3-D map."""


def pack(
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FILE", help="The site file to write")
    ],
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[STUDY/GRID/METHOD]",
            help="A model of a study, such as campus/10m/sci_ring; a variant is METHOD-VARIANT",
        ),
    ] = None,
    maps: Annotated[
        list[Path] | None,
        typer.Option(
            "--map",
            metavar="MAP",
            help="Pack a map instead of a model: a 3-D map (.pcd .ply .las .laz, a folder of "
            "tiles; several with several --map), or a Nav2 map MAP.yaml for a level laser",
        ),
    ] = None,
    like: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="SCAN",
            help="With a 3-D map: a scan of your robot in the vehicle's frame, which tells its "
            "sensor and whether its ground is cut off; may be given up to ten times",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(metavar="M", help="With a 3-D map: keep one point in each M metres [0.4]"),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="With a 3-D map: the position in it that becomes the site's origin, in metres",
        ),
    ] = None,
    datum: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,ALT[,HEADING]",
            help="Where the site's origin lies on the Earth (WGS 84, degrees and metres), and the "
            "direction of its x axis, in degrees counter-clockwise from east: for --gnss",
        ),
    ] = None,
) -> None:
    """Pack a model, or a map that you have, into one site file with all that localisation needs."""
    from pipeline.core.datum import Datum
    from pipeline.formats import autoware
    from pipeline.online.level_pack import pack_map as pack_level_map
    from pipeline.online.map_pack import pack_map
    from pipeline.online.pack import Packing, Trained
    from pipeline.studies.layout import Layout

    only_one({"STUDY/GRID/METHOD": name, "map": maps})
    at = None if datum is None else Datum.parse("--datum", datum)
    check_file(out)
    yamls = [path for path in maps or [] if path.suffix in (".yaml", ".yml")]
    is_level = any(not path.is_file() or not autoware.read_metadata(path) for path in yamls)
    if (is_level or not maps) and (like or cell is not None or origin is not None):
        raise ConfigError("--like, --cell and --origin are for a 3-D map: --map city.pcd")
    if maps and is_level:
        if len(maps) > 1:
            raise ConfigError(f"--map {maps[1]}: a level site has one Nav2 map, {maps[0]}")
        print(pack_level_map(maps[0], out, at))
    elif maps:
        options = replace(map_options(like or [], cell, origin), datum=at)
        for line in pack_map(maps, out, options, Bar()):
            print(line)
    elif name is None:
        raise ConfigError("pack: expected STUDY/GRID/METHOD, or --map MAP")
    else:
        model = Trained.of_study(Layout(), *named_model(name))
        print(Packing(conf_folder()).pack(model, out, Bar(), at))


def map_options(like: list[Path], cell_m: float | None, origin: str | None) -> "MapOptions":
    """The options of a 3-D map; raises ConfigError for values that cannot be."""
    from pipeline.online.inputs import points_of_file
    from pipeline.online.map_pack import MapOptions
    from pipeline.online.site import finite
    from pipeline.posing.map_day import VOXEL_M

    if len(like) > MOST_LIKE:
        raise ConfigError(f"--like: {len(like)} scans; expected at most {MOST_LIKE}")
    if cell_m is not None and not LEAST_CELL_M <= cell_m <= MOST_CELL_M:
        raise ConfigError(f"--cell {cell_m:g}: expected {LEAST_CELL_M} to {MOST_CELL_M} metres")
    origin_m = (0.0, 0.0, 0.0)
    if origin is not None:
        try:
            x_m, y_m, z_m = (float(word) for word in origin.split(","))
        except ValueError:
            raise ConfigError(f"--origin {origin:.60}: expected X,Y,Z in metres") from None
        if not all(map(math.isfinite, (x_m, y_m, z_m))):
            raise ConfigError(f"--origin {origin:.60}: expected finite numbers")
        origin_m = (x_m, y_m, z_m)
    scans = []
    for path in like:
        if not path.is_file():
            raise ConfigError(f"--like {path}: no such scan")
        points_m = finite(points_of_file(path))
        if not len(points_m):
            raise ConfigError(f"--like {path}: it has no finite point; name another scan")
        scans.append(points_m)
    return MapOptions(origin_m, VOXEL_M if cell_m is None else cell_m, tuple(scans))


def export(
    path: SitePath,
    out: Annotated[
        str,
        typer.Option(
            "-o",
            "--out",
            metavar="OUT",
            help="The map: FILE.pcd, FILE.ply, FOLDER/ of Autoware's tiles, of a level site "
            "FILE.yaml; the network alone: FILE.onnx; a site that runs it without torch: FILE.site",
        ),
    ],
    compact: Annotated[
        bool,
        typer.Option(
            "--compact",
            help="With FILE.onnx or FILE.site: weights in 8 bits, a quarter of the size",
        ),
    ] = False,
) -> None:
    """Export a site's map as a point cloud, or its network as ONNX."""
    if Path(out).suffix in (".onnx", ".site") and not out.endswith("/"):
        _refuse_map_site(path, out)
        from pipeline.online import export as networks

        check_file(Path(out))
        print(networks.export(path, Path(out), compact))
        return
    from pipeline.mapping.map_output import MapOutput
    from pipeline.online.export_map import NAV2_SUFFIXES, export_map

    if compact:
        raise ConfigError("--compact is for a network: -o FILE.onnx or -o FILE.site")
    is_file = Path(out).suffix in NAV2_SUFFIXES or not MapOutput.of(out).is_folder
    (check_file if is_file else check_folder)(Path(out))
    lines, is_simulated = export_map(path, out, Bar())
    for line in lines:
        print(line)
    if is_simulated:
        print("the site is simulated, not recorded", file=sys.stderr)


def _refuse_map_site(path: Path, out: str) -> None:
    """Raise ConfigError for the site of a 3-D map, which has no network."""
    from pipeline.online import site_file

    if site_file.read(path).description.map.is_tiled:
        raise ConfigError(
            f"-o {out}: {path} is the site of a 3-D map, which has no network; its map is written "
            "with -o FILE.pcd, FILE.ply or FOLDER/"
        )
