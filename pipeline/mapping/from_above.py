"""Pictures from above: the objects along a drive, a scan placed among them, and the robot.

In: scans gathered into submaps, or the points of any map. Out: a `Footprint` of the standing
objects, the points of a `Drive`, and the drawing of a scan on a map (`scan_on_map`) that figures
and failure cards share. The page's map, the plan of a building and the animations use these too.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.frames import Poses, transformed, travelled_m
from pipeline.core.schemas import Scans, Submaps
from pipeline.mapping.gathering import submap_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STANDING_M = (0.8, 12.0)
"""Points between these heights above the ground are drawn: walls and trunks, no ground, no
crowns."""
FLAT_M = 0.5
"""A cloud of a smaller height is of a laser that sweeps one plane: all of it is drawn."""
APART_M = 4.0
"""Distance between the submaps of a drive that make a footprint."""
CELL_M = 0.5
"""Side of a drawn cell."""
LARGEST_PX = 2_000
"""Largest number of cells along a footprint's side; larger footprints have larger cells."""
MOST_NOISE_POINTS = 1
"""A cell with this many points, or fewer, is taken to be noise."""
REACH_M = 63.0
"""Points farther from the anchor do not fit into the bytes of `Drive.cells`."""
MOST_CELLS = 300
"""Largest number of a scan's cells that are drawn on the page."""
MAP_GREY = "#C4C3BD"
INKS = {True: "#C8400A", False: "#0072B2"}
"""Colours of a scan whose pose was accepted though wrong, and of one that was rejected."""
ROBOT = np.array([(3.2, 0.0, 0.0), (-2.0, 1.6, 0.0), (-1.0, 0.0, 0.0), (-2.0, -1.6, 0.0)])
"""The corners (4, 3) of the arrow that stands for the robot, in metres in its frame."""


def standing(
    points_m: NDArray[np.float64], heights_m: tuple[float, float] = STANDING_M
) -> NDArray[np.float64]:
    """The points (n, 3) of a scan between two heights above the ground: of standing objects.

    They are all points of a laser that sweeps one plane.
    """
    low_m, high_m = heights_m
    z_m = points_m[:, 2]
    if not len(points_m) or np.ptp(z_m) < FLAT_M:
        return points_m
    return points_m[(z_m > low_m) & (z_m < high_m)]


@dataclass(frozen=True, eq=False)
class Drive:
    """The scans of one drive, gathered into submaps."""

    scans: Scans
    submaps: Submaps
    world_T_anchor: Poses
    """(n, 4, 4) the submaps' poses."""

    @classmethod
    def read(cls, scans: Path, submaps: Path) -> Self:
        """Open a drive; raises ArtifactError if its scans or submaps are missing."""
        anchors = store.read(submaps, Submaps)
        return cls(store.read(scans, Scans), anchors, anchors.load("world_T_anchor"))

    def standing_m(self, row: int) -> NDArray[np.float64]:
        """The points (n, 3) of a submap's standing objects, in the frame of its anchor."""
        submaps = submap_points(self.scans, self.submaps, slice(row, row + 1))
        return standing(next(iter(submaps)))

    def cells(self, row: int) -> NDArray[np.int8]:
        """The cells (n, 2) of side CELL_M with standing objects of a submap, from its anchor on.

        There are at most MOST_CELLS of them, chosen at random with a fixed seed.
        """
        xy_m = self.standing_m(row)[:, :2]
        near_m = xy_m[np.abs(xy_m).max(axis=1, initial=0.0) < REACH_M]
        cells = np.unique(np.rint(near_m / CELL_M).astype(np.int8), axis=0)
        if len(cells) > MOST_CELLS:
            cells = np.random.default_rng(0).choice(cells, MOST_CELLS, replace=False)
        return cells


def along(drives: Iterable[Drive]) -> NDArray[np.float64]:
    """The points (n, 3) in the world of standing objects along drives: a submap every APART_M."""
    clouds = []
    for drive in drives:
        driven_m = travelled_m(drive.world_T_anchor[:, :2, 3])
        rows = np.unique(np.floor(driven_m / APART_M), return_index=True)[1]
        clouds += [transformed(drive.world_T_anchor[row], drive.standing_m(row)) for row in rows]
    return np.concatenate(clouds)


@dataclass(frozen=True, eq=False)
class Footprint:
    """The cells of the ground plane with standing objects."""

    occupied: NDArray[np.bool_]
    """(row, column), the southernmost row first"""
    corner_m: NDArray[np.float64]
    """(2,) the south-western corner in the world"""
    cell_m: float

    @classmethod
    def of(
        cls, points_m: NDArray[np.float64], noise_points: int = MOST_NOISE_POINTS
    ) -> Self | None:
        """The footprint of points (n, 3) of standing objects in the world; None without points.

        A cell with `noise_points` or fewer is taken to be noise.
        """
        xy_m = points_m[:, :2]
        if not len(xy_m):
            return None
        corner_m = xy_m.min(axis=0)
        cell_m = max(CELL_M, float(np.ptp(xy_m, axis=0).max()) / LARGEST_PX)
        column, row = np.floor((xy_m - corner_m) / cell_m).astype(np.int64).T
        counts = np.zeros((row.max() + 1, column.max() + 1), np.int64)
        np.add.at(counts, (row, column), 1)
        return cls(counts > noise_points, corner_m, cell_m)

    def draw(self, axes: "Axes") -> None:
        """Draw the cells in grey on a panel whose coordinates are those of the world."""
        from matplotlib.colors import ListedColormap

        far_corner_m = self.corner_m + np.array(self.occupied.shape[::-1]) * self.cell_m
        extent: Any = tuple(np.stack([self.corner_m, far_corner_m], axis=1).ravel())
        cells = np.ma.masked_equal(self.occupied.astype(float), 0.0)
        grey = ListedColormap([MAP_GREY])
        axes.imshow(cells, cmap=grey, extent=extent, origin="lower", interpolation="nearest")


def scan_on_map(
    axes: "Axes",
    footprint: Footprint | None,
    points_m: NDArray[np.float64],
    world_T_scan: Poses,
    ink: str,
    half_m: float,
) -> None:
    """Draw a scan at its pose (4, 4) on the map around it, with an arrow along its heading.

    The scan's standing points (n, 3) become cells of side CELL_M in the colour `ink`. The panel
    reaches `half_m` to each side.
    """
    if footprint is not None:
        footprint.draw(axes)
    xy_m = transformed(world_T_scan, points_m)[:, :2]
    cells_m = np.unique(np.rint(xy_m / CELL_M), axis=0) * CELL_M
    axes.plot(*cells_m.T, ".", ms=2.2, mew=0, color=ink, rasterized=True)
    draw_heading(axes, world_T_scan, ink)
    x_m, y_m = world_T_scan[:2, 3]
    axes.set(xlim=(x_m - half_m, x_m + half_m), ylim=(y_m - half_m, y_m + half_m))
    axes.set(xticks=[], yticks=[], aspect="equal")


def draw_heading(axes: "Axes", world_T_robot: Poses, ink: str) -> None:
    """Draw an arrow of 8 m at a robot (4, 4), along its heading."""
    start_m = world_T_robot[:2, 3] - 3.0 * world_T_robot[:2, 0]
    end_m = start_m + 8.0 * world_T_robot[:2, 0]
    axes.annotate(
        "", tuple(end_m), tuple(start_m), arrowprops={"arrowstyle": "->", "color": ink, "lw": 1.4}
    )
