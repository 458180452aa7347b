"""`yearloc pack` writes a site file; `yearloc export` makes a site that runs without torch.

A site is one file with all that it takes to localise in a place: a study's model and map, or the
map of a building for a level laser. An export is a site's network as ONNX, or a site that answers
through ONNX.
"""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.options import SitePath, only_one
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Bar
from pipeline.cli.project import conf_folder, named_model
from pipeline.core.errors import ConfigError


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
    level_map: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="MAP.yaml", help="Pack a Nav2 map for a level laser, not a model"
        ),
    ] = None,
) -> None:
    """Pack a model and its map into one site file, with all that localisation needs."""
    from pipeline.online.level_pack import pack_map
    from pipeline.online.pack import Packing, Trained
    from pipeline.studies.layout import Layout

    only_one({"STUDY/GRID/METHOD": name, "map": level_map})
    check_file(out)
    if level_map is not None:
        print(pack_map(level_map, out))
        return
    if name is None:
        raise ConfigError("pack: expected STUDY/GRID/METHOD, or --map MAP.yaml")
    model = Trained.of_study(Layout(), *named_model(name))
    print(Packing(conf_folder()).pack(model, out, Bar()))


def export(
    path: SitePath,
    out: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE.onnx|FILE.site",
            help="The file to write: the network alone, or a whole site that uses it",
        ),
    ],
    compact: Annotated[
        bool,
        typer.Option("--compact", help="Store weights in 8 bits, a quarter of the size"),
    ] = False,
) -> None:
    """Export a site's network as ONNX, or a site that runs it without torch."""
    from pipeline.online import export as networks

    check_file(out)
    print(networks.export(path, out, compact))
