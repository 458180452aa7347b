"""A picture of a 3-D map from above: what stands on its ground, by height, and the ground itself.

Cells in which something stands are coloured by its height. It stands if its points are one above
the other, as those of walls, trunks and crowns are: a ceiling would hide the walls below it. The
ground is tinted by its own height. A bar says the scale.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from pipeline.core.replacing import replace
from pipeline.inspection.inspection import metres
from pipeline.inspection.point_map import VOXEL_M, PointMap
from pipeline.mapping.local_ground import LocalGround
from pipeline.mapping.tiled_map import TiledMap
from pipeline.report.figures.style import QUIET, styled
from pipeline.views.walls import Walls

LARGEST_PX = 1_600
"""Largest number of cells along a side; larger maps have larger cells."""
LOWEST_M = 0.2
"""Points higher above the ground than this may be of what stands on it."""
MOST_LEVELS = 40
"""Levels of VOXEL_M from there on; what is higher is in the last one."""
HIGHEST_M = 12.0
"""What is higher above the ground has the colour of this height."""
MARGIN_M = 4.0
"""The ground is tinted this far around the points."""
CLOSED_M = 8.0
"""Gaps between points up to about twice as wide are tinted too."""
SMOOTH_M = 6.0
"""The shown heights of the ground are smoothed by a Gaussian of this standard deviation."""
BAR_SHARE = 0.22
"""The scale bar is not longer than this share of the width."""
SIDE_IN = 9.0
"""The longer side of the map on paper."""
HEAD_IN = 0.75
"""Height of the title and the margins."""
FOOT_IN = 0.85
"""Height of the bars of colours."""
DPI = 200
STANDING = LinearSegmentedColormap.from_list(
    "standing", ["#9FB7CF", "#3E77B0", "#27418C", "#5B1F79", "#B0245E", "#E8552D", "#F6A01A"]
)
GROUND = LinearSegmentedColormap.from_list(
    "ground", ["#C3DDCB", "#E6EBD3", "#F6EFDA", "#EBD6B4", "#DDBB8E"]
)
DARK = "0.13"


class Raster(NamedTuple):
    """A map on a grid, seen from above; the first row is the southernmost."""

    standing_m: NDArray[np.float64]
    """(row, column) the height above the ground of what stands there; NaN where nothing does."""
    ground_m: NDArray[np.float64]
    """(row, column) z of the ground; NaN away from all points."""
    extent_m: tuple[float, float, float, float]
    """The least and largest x, then y."""


def write(point_map: PointMap, path: Path) -> None:
    """Draw a map that has a ground into a .png; the same map gives the same bytes."""
    assert point_map.ground is not None
    drawn = raster(point_map.tiled, point_map.ground)
    with replace(path) as scratch:
        _figure(drawn, point_map.files.name).savefig(
            scratch, dpi=DPI, format="png", metadata={"Software": None}
        )


def raster(tiled: TiledMap, ground: LocalGround) -> Raster:
    """The map on a grid of at most LARGEST_PX cells to a side."""
    low_m, high_m = tiled.box_m
    low_m = low_m[:2] - MARGIN_M - CLOSED_M
    sides_m = high_m[:2] + MARGIN_M + CLOSED_M - low_m
    cell_m = max(VOXEL_M, float(sides_m.max()) / LARGEST_PX)
    low_m = np.floor(low_m / cell_m) * cell_m  # cells of the size of voxels are voxels
    columns, rows = np.ceil(sides_m / cell_m).astype(np.int64) + 1
    levels = np.zeros((rows, columns), np.int64)
    is_covered = np.zeros((rows, columns), bool)
    for points_m in tiled.tiles_m():
        column, row = np.floor((points_m[:, :2] - low_m) / cell_m).astype(np.int64).T
        above_m = points_m[:, 2] - ground.heights_m(points_m[:, :2])
        is_covered[row, column] = True
        level = np.floor((above_m - LOWEST_M) / VOXEL_M)
        is_known = level >= 0
        bits = 1 << level[is_known].clip(max=MOST_LEVELS - 1).astype(np.int64)
        np.bitwise_or.at(levels, (row[is_known], column[is_known]), bits)
    ground_m = _ground(ground, low_m, cell_m, (rows, columns))
    # gaps such as streets are closed: the ground is widened, and narrowed again
    is_near = cell_m * np.asarray(distance_transform_edt(~is_covered)) < MARGIN_M + CLOSED_M
    is_far_inside = cell_m * np.asarray(distance_transform_edt(is_near)) > CLOSED_M
    ground_m[~is_far_inside] = np.nan
    rim = int(CLOSED_M / cell_m)  # which closing gaps takes
    inner = (slice(rim, rows - rim), slice(rim, columns - rim))
    near_m = low_m + rim * cell_m
    far_m = low_m + (np.array([columns, rows]) - rim) * cell_m
    extent_m = (float(near_m[0]), float(far_m[0]), float(near_m[1]), float(far_m[1]))
    return Raster(_standing_m(levels)[inner], ground_m[inner], extent_m)


def _standing_m(levels: NDArray[np.int64]) -> NDArray[np.float64]:
    """The height (row, column) of what stands in each cell, of which `levels` has a bit for each
    level with points; NaN where nothing does."""
    upright = levels & (levels << 1 | levels << 2)
    _, count = np.frexp(upright.astype(np.float64))  # one more than the highest bit, exactly
    height_m = LOWEST_M + count * VOXEL_M
    return np.where((upright > 0) & (height_m > Walls().low_m), height_m, np.nan)


def _ground(
    ground: LocalGround, low_m: NDArray[np.float64], cell_m: float, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """The smoothed z (row, column) of the ground; NaN where there is none."""
    ground_m = np.empty(shape)
    x_m = low_m[0] + (np.arange(shape[1]) + 0.5) * cell_m
    for row in range(shape[0]):
        y_m = low_m[1] + (row + 0.5) * cell_m
        ground_m[row] = ground.heights_m(np.column_stack([x_m, np.full(len(x_m), y_m)]))
    is_known = np.isfinite(ground_m)
    spread = SMOOTH_M / cell_m
    weights = gaussian_filter(is_known.astype(np.float64), spread)
    sums_m = gaussian_filter(np.where(is_known, ground_m, 0.0), spread)
    return np.where(is_known, sums_m / np.where(is_known, weights, 1.0), np.nan)


@styled
def _figure(raster: Raster, title: str) -> Figure:
    """The picture with its title, its scale and the bars of its colours."""
    left_m, right_m, bottom_m, top_m = raster.extent_m
    width_m, height_m = right_m - left_m, top_m - bottom_m
    scale = SIDE_IN / max(width_m, height_m)
    width_in = max(width_m * scale, 0.45 * SIDE_IN) + 0.9
    height_in = max(height_m * scale, 0.15 * SIDE_IN)
    figure = Figure(figsize=(width_in, height_in + HEAD_IN + FOOT_IN), facecolor="white")
    full_in = height_in + HEAD_IN + FOOT_IN
    axes = figure.add_axes(
        (0.65 / width_in, FOOT_IN / full_in, 1 - 0.9 / width_in, height_in / full_in)
    )
    _draw_ground(axes, raster)
    axes.imshow(
        raster.standing_m,
        cmap=STANDING,
        norm=Normalize(Walls().low_m, HIGHEST_M),
        extent=raster.extent_m,
        origin="lower",
        interpolation="nearest",
        zorder=3,
    )
    axes.set(xlim=(left_m, right_m), ylim=(bottom_m, top_m), aspect="equal")
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(colors=QUIET, labelsize=7)
    axes.spines[:].set_visible(True)
    axes.spines[:].set(color="0.8", linewidth=0.6)
    axes.set_xlabel("x in m", color=QUIET, fontsize=7.5)
    axes.set_ylabel("y in m", color=QUIET, fontsize=7.5)
    _draw_scale(axes, raster)
    head: Any = {"transform": figure.transFigure, "va": "top", "color": DARK}
    start = 0.65 / width_in
    figure.text(start, 1 - 0.14 / full_in, title, size=12, weight="bold", **head)
    sides = f"{metres(width_m - 2 * MARGIN_M)} × {metres(height_m - 2 * MARGIN_M)}, seen from above"
    figure.text(start, 1 - 0.4 / full_in, sides, size=8.5, **{**head, "color": QUIET})
    _draw_colours(figure, raster)
    return figure


def _draw_ground(axes: Axes, raster: Raster) -> None:
    """Tint the ground by its height."""
    axes.imshow(
        raster.ground_m,
        cmap=GROUND,
        norm=Normalize(*_heights(raster)),
        extent=raster.extent_m,
        origin="lower",
        zorder=1,
    )


def _draw_scale(axes: Axes, raster: Raster) -> None:
    """Draw a bar of a round length in the emptiest corner."""
    left_m, right_m, bottom_m, top_m = raster.extent_m
    width_m, height_m = right_m - left_m, top_m - bottom_m
    length_m = _round_down(BAR_SHARE * width_m)
    share = (length_m / width_m + 0.06, 0.1)
    rows, columns = raster.ground_m.shape
    part = (int(share[1] * rows) + 1, int(share[0] * columns) + 1)
    is_known = np.isfinite(raster.ground_m)
    corners = {
        (0, 0): is_known[: part[0], : part[1]],
        (1, 0): is_known[: part[0], -part[1] :],
        (0, 1): is_known[-part[0] :, : part[1]],
        (1, 1): is_known[-part[0] :, -part[1] :],
    }
    at_right, at_top = min(corners, key=lambda corner: corners[corner].sum())
    margin_m = 0.025 * max(width_m, height_m)
    x_m = right_m - margin_m - length_m if at_right else left_m + margin_m
    y_m = top_m - 2 * margin_m if at_top else bottom_m + margin_m
    tick_m = 0.006 * max(width_m, height_m)
    axes.plot(
        [x_m, x_m, x_m + length_m, x_m + length_m],
        [y_m + tick_m, y_m, y_m, y_m + tick_m],
        color=DARK,
        lw=1.3,
        solid_joinstyle="miter",
        zorder=5,
    )
    veil = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0}
    axes.text(
        x_m + length_m / 2,
        y_m + 1.3 * tick_m,
        f"{length_m:g} m" if length_m < 1000 else f"{length_m / 1000:g} km",
        ha="center",
        va="bottom",
        size=8,
        color=DARK,
        bbox=veil,
        zorder=4,
    )


def _draw_colours(figure: Figure, raster: Raster) -> None:
    """Draw the two bars of colours below the map."""
    width_in, height_in = figure.get_size_inches()
    low_m, high_m = _heights(raster)
    bars = (
        (
            STANDING,
            Normalize(Walls().low_m, HIGHEST_M),
            f"height above the ground in m, {HIGHEST_M:g} and more",
        ),
        (GROUND, Normalize(low_m, high_m), "z of the ground in m"),
    )
    usable = 1 - 0.9 / width_in
    for place, (colours, norm, label) in enumerate(bars):
        start = 0.65 / width_in + place * 0.52 * usable
        bar = figure.add_axes((start, 0.34 / height_in, 0.42 * usable, 0.08 / height_in))
        figure.colorbar(ScalarMappable(norm, colours), cax=bar, orientation="horizontal")
        bar.tick_params(labelsize=6.5, colors=QUIET, length=2)
        bar.xaxis.set_label_position("bottom")
        bar.set_xlabel(label, size=7.5, color=DARK, labelpad=1.5, loc="left")
        for spine in bar.spines.values():
            spine.set_visible(False)


def _heights(raster: Raster) -> tuple[float, float]:
    """The range of the ground's heights, of at least a metre."""
    low_m, high_m = (float(z_m) for z_m in np.nanquantile(raster.ground_m, (0.005, 0.995)))
    middle_m = (low_m + high_m) / 2
    half_m = max(high_m - low_m, 1.0) / 2
    return middle_m - half_m, middle_m + half_m


def _round_down(length_m: float) -> float:
    """The largest of 1, 2, 5, 10 … times a power of ten that is not above a length."""
    power = 10 ** np.floor(np.log10(length_m))
    return float(power * max(step for step in (1, 2, 5) if step * power <= length_m))
