"""Stage `squares`: makes the training day of a study that learns a 3-D map instead of a drive.

It reads the map's files and cuts the map into squares. The squares stand for the scans of a day, so
that the later stages draw and label them like those of a drive. The stage also writes the map with
which the stage `poses` registers queries.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from pipeline.core.settings import Positive
from pipeline.mapping.anchored_map import AnchoredMap
from pipeline.mapping.tiled_map import Thinning
from pipeline.opening.map_files import MapFiles
from pipeline.posing.map_day import drawn_walls, write_map, write_scans
from stages import ProgressBar, stage


@dataclass(frozen=True)
class DataSet:
    """The settings of a file of conf/dataset that this stage uses."""

    reader: DictConfig
    """The reader of the drives. If it has a `lift_m`, it moves the world's frame down by it."""


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/squares.yaml."""

    dataset: DataSet
    """The data set of the drives."""
    files: Path
    """The map: a file, or a folder of tiles."""
    voxel_m: Positive
    """Side of a voxel; one point of each voxel is kept."""
    range_m: Positive
    """Range of the cut-outs that queries are registered with."""
    grain_m: Positive
    """Length of one unit of the stored points of a square, which are whole numbers."""
    map: Path
    """Where the map is written."""
    out: Path
    """Where the squares are written, as scans."""
    cut_m: float | None = None
    """Height below which the map has no points, if its ground was cut off; None: it is found."""


@stage("squares")
def main(settings: Settings) -> str:
    progress = ProgressBar()
    files = MapFiles.of([settings.files])
    thinning = Thinning(settings.voxel_m)
    world_m = np.array([0.0, 0.0, settings.dataset.reader.get("lift_m", 0.0)])
    for points_m in files.chunks(progress):
        thinning.add(points_m + world_m)  # into the world of the drives
    anchored = AnchoredMap.of(thinning.tiled(), files.name, settings.cut_m, progress)
    drawn = drawn_walls(anchored, files.name, progress)
    write_map(settings.map, anchored, drawn, settings.voxel_m, settings.range_m)
    n_points = write_scans(settings.out, anchored, settings.grain_m, progress)
    n_squares = len(anchored.world_T_anchor)
    return "; ".join([f"{n_squares} squares, {n_points / 1e6:.1f} M points", *files.notes])


if __name__ == "__main__":
    main()
