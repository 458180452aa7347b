"""What the laser saw, from above: the footprint of the training drive, and scans to lay on it.

In: a study whose scans are on the disk. Out: a `Footprint`, the map that the page and figures draw,
and a `Drive`, which gives the points of any submap (a scan, or several gathered at one pose).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.core.errors import ArtifactError
from pipeline.core.frames import Poses, moved, travelled_m
from pipeline.core.schemas import Scans, Submaps
from pipeline.mapping.gathering import submap_points
from pipeline.report.figures.style import png_text
from pipeline.report.study import Study

# Points between these heights above the ground are drawn: walls and trunks, no ground, no crowns.
STANDING_M = (0.8, 12.0)
FLAT_M = 0.5  # a less high cloud is of a laser that sweeps one plane: all of it is drawn
APART_M = 4.0  # distance between the training submaps that make the footprint
CELL_M = 0.5
LARGEST_PX = 2_000  # the longer side of a footprint; its cells grow with it
MOST_NOISE_POINTS = 1  # so many points in a cell, or fewer, are taken for noise
REACH_M = 63.0  # points farther from the anchor do not fit into the bytes of `Drive.cells`
MOST_CELLS = 300  # of a scan that are drawn


@dataclass(frozen=True, eq=False)
class Footprint:
    """The cells of the ground on which something stood when training drove there."""

    occupied: NDArray[np.bool_]  # (row, column), the southernmost row first
    corner_m: NDArray[np.float64]  # (2,) the south-western corner in the world
    cell_m: float

    @classmethod
    def read(cls, study: Study) -> Self | None:
        """Read it from the training drives; None if their scans are not here."""
        try:
            xy_m = trained_m(study)[:, :2]
        except ArtifactError:
            return None
        if not len(xy_m):
            return None
        corner_m = xy_m.min(axis=0)
        cell_m = max(CELL_M, float(np.ptp(xy_m, axis=0).max()) / LARGEST_PX)
        column, row = np.floor((xy_m - corner_m) / cell_m).astype(np.int64).T
        counts = np.zeros((row.max() + 1, column.max() + 1), np.int64)
        np.add.at(counts, (row, column), 1)
        return cls(counts > MOST_NOISE_POINTS, corner_m, cell_m)

    def png(self) -> str:
        """A PNG in base64, one bit a cell, north up, transparent where nothing stood."""
        return png_text(Image.fromarray(self.occupied[::-1]), transparency=0)


def trained_m(study: Study) -> NDArray[np.float64]:
    """The points (n, 3) in the world of what stood along the training drives.

    Raises ArtifactError if their scans or submaps are not here.
    """
    clouds = []
    for sequence in study.settings.train:
        drive = Drive.read(study, sequence)
        driven_m = travelled_m(drive.world_T_anchor[:, :2, 3])
        rows = np.unique(np.floor(driven_m / APART_M), return_index=True)[1]
        clouds += [moved(drive.world_T_anchor[row], drive.standing_m(row)) for row in rows]
    return np.concatenate(clouds)


@dataclass(frozen=True, eq=False)
class Drive:
    """The scans of one drive, gathered into submaps."""

    scans: Scans
    submaps: Submaps
    world_T_anchor: Poses  # (n, 4, 4)

    @classmethod
    def read(cls, study: Study, sequence: str) -> Self:
        """Open a drive; raises ArtifactError if its scans or submaps are not here."""
        submaps = study.artifact(Submaps, "submaps", sequence)
        scans = study.artifact(Scans, "scans", sequence)
        return cls(scans, submaps, submaps.load("world_T_anchor"))

    def standing_m(self, row: int) -> NDArray[np.float64]:
        """The points (n, 3) of a submap that stand on the ground, in the frame of its anchor."""
        points_m = next(iter(submap_points(self.scans, self.submaps, slice(row, row + 1))))
        heights_m = points_m[:, 2]
        low_m, high_m = STANDING_M
        if not len(points_m) or np.ptp(heights_m) < FLAT_M:
            return points_m
        return points_m[(heights_m > low_m) & (heights_m < high_m)]

    def cells(self, row: int) -> NDArray[np.int8]:
        """The cells (n, 2) of side CELL_M that a submap's points stand in, counted from its anchor.

        There are at most MOST_CELLS of them, chosen at random but the same each time.
        """
        xy_m = self.standing_m(row)[:, :2]
        near_m = xy_m[np.abs(xy_m).max(axis=1, initial=0.0) < REACH_M]
        cells = np.unique(np.rint(near_m / CELL_M).astype(np.int8), axis=0)
        if len(cells) > MOST_CELLS:
            cells = np.random.default_rng(0).choice(cells, MOST_CELLS, replace=False)
        return cells
