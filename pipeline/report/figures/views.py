"""What methods look at: one place as a Scan Context, and a scan as it becomes a bird-view.

`place` draws Fig. 3, 5 and 9(a) of the SCI paper (Kim, Park and Kim, RA-L 2019), `bird_view` Fig. 2
of paper 2 (Yin et al., IROS 2018, "Stabilize an Unsupervised Feature Learning for LiDAR-based Place
Recognition"). All clouds are seen from above, with the robot's front up: x
is drawn upwards, and y to the left.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.rows import case_text
from pipeline.mapping.octree import OctreeMap, log_odds
from pipeline.perturbations import Case, Perturbation, generator
from pipeline.report.figures.style import WIDTH_IN, figure, styled
from pipeline.views.birdview import BirdView
from pipeline.views.scan_context import ScanContext, colorize

COLOURS = "viridis"  # of heights
MOST_POINTS = 30_000  # of one cloud that are drawn, evenly spread
ROBOT = "#D55E00"
TOP_M = 15.0  # where the colours of heights end, as those of a Scan Context's image do
ROW_IN = 1.35  # height of the row of one cloud in `place`
NODE_LEVELS = 2  # levels above the leaves of the nodes that `bird_view` shows


def perturbed(
    points_m: NDArray[np.floating], perturbation: Perturbation, stamp_ns: int
) -> Mapping[str, NDArray[np.floating]]:
    """The cloud (n, 3) in each case of a perturbation, and unperturbed, by the case's text."""
    clouds = {}
    for case in perturbation.cases:
        if case == Case():  # which perturbs nothing
            clouds["unperturbed"] = points_m
        else:
            random = generator(perturbation, stamp_ns)
            clouds[case_text(case)] = perturbation.perturb(case, points_m, random)[0]
    return clouds


@styled
def place(clouds_m: Mapping[str, NDArray[np.floating]], view: ScanContext) -> Figure:
    """One row per cloud (n, 3): from above, its Scan Context in metres, and its colour image."""
    fig = figure(WIDTH_IN, 0.3 + ROW_IN * len(clouds_m), "One place as methods see it")
    widths = {"width_ratios": [1.0, 1.8, 1.8]}
    rows = fig.subplots(len(clouds_m), 3, squeeze=False, gridspec_kw=widths)
    heights = Normalize(0.0, TOP_M)
    for (name, points_m), (cloud, context, image) in zip(clouds_m.items(), rows, strict=True):
        _cloud(cloud, points_m, view.max_range_m, heights, dot_size=0.2)
        _robot(cloud, view.max_range_m, ms=4)
        cloud.set_ylabel(name)
        heights_m = view(points_m)
        shown: Any = {"origin": "lower", "aspect": "auto", "interpolation": "nearest"}
        # a bin without points has the height 0, and stays blank
        filled_m = np.where(heights_m != 0, heights_m, np.nan)
        context.imshow(filled_m, cmap=COLOURS, norm=heights, **shown)
        image.imshow(colorize(heights_m), **shown)
        for axis in (context, image):
            axis.set(xticks=[], yticks=[])
    for axis, title in zip(rows[0], ("cloud", "Scan Context", "its image"), strict=True):
        axis.set_title(title)
    for axis in rows[-1, 1:]:
        axis.set_xlabel("sector, from ahead to the left")
    rows[0, 1].set_ylabel("ring")
    return fig


@styled
def bird_view(
    points_m: NDArray[np.floating],
    octree_map: OctreeMap,
    odom_T_vehicle: NDArray[np.float64],
    view: BirdView,
) -> Figure:
    """A scan (n, 3), the highest leaves and nodes of the octree map around it, and its bird-view.

    The scan is the newest one in the map, and in the vehicle's frame. Leaves and nodes are those in
    the view's band of heights, and the bird-view is that of heading 0.
    """
    octree = octree_map.octree
    heights = Normalize(0.0, view.high_m)
    half_m = octree.edge_m / 2
    fig = figure(WIDTH_IN, 2.7, "From a scan to its bird-view")
    axes = fig.subplots(1, 4)
    scan, leaves, nodes, image = axes
    _cloud(scan, points_m, half_m, heights, dot_size=0.15)
    scan.set_title(f"scan, {len(points_m):,} points")
    panels = ((leaves, "leaves", octree.depth), (nodes, "nodes", octree.depth - NODE_LEVELS))
    for axis, name, depth in panels:
        corners_m, tops_m = tops(octree_map, odom_T_vehicle, view, depth)
        drawn_m = np.stack([-corners_m[..., 1], corners_m[..., 0]], axis=-1)
        squares = PolyCollection([*drawn_m], cmap=COLOURS, norm=heights)
        squares.set(array=tops_m, linewidth=0, rasterized=True)
        axis.add_collection(squares)
        axis.set_title(f"occupied {name} of {octree.edge_m / 2**depth:.2f} m")
    grey = view.draw(octree_map, odom_T_vehicle)[0]  # of heading 0
    extent = (-half_m, half_m, -half_m, half_m)
    image.imshow(grey, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
    image.set_title(f"bird-view, {view.side_px} × {view.side_px}")
    for axis in axes:
        _robot(axis, half_m, ms=3.5, mew=0)
        axis.spines[:].set_visible(True)
    small: Any = {"location": "bottom", "shrink": 0.35, "aspect": 35, "pad": 0.03}
    scale = fig.colorbar(ScalarMappable(heights, COLOURS), ax=axes, **small)
    scale.set_label(
        f"height in metres; each panel shows {2 * half_m:g} m × {2 * half_m:g} m around the robot"
    )
    return fig


def tops(
    octree_map: OctreeMap, odom_T_vehicle: NDArray[np.float64], view: BirdView, depth: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The columns of octree nodes that hold an occupied leaf in the view's band of heights.

    Nodes are those at `depth`. Returns the corners (n, 4, 2) of each column in the vehicle's frame,
    and the height above the vehicle of its highest such leaf (n,), all in metres.
    """
    leaf_tops_m = _highest_leaves(octree_map, odom_T_vehicle, view)
    nodes = 2**depth  # along a side of the map
    leaves = octree_map.octree.side // nodes  # along a side of a node
    node_tops_m = leaf_tops_m.reshape(nodes, leaves, nodes, leaves).max(axis=(1, 3))
    is_occupied = np.isfinite(node_tops_m)  # (node along x, node along y)
    node_m = octree_map.octree.edge_m / nodes
    corners_m = _corners(octree_map, odom_T_vehicle, np.argwhere(is_occupied), node_m)
    return corners_m, node_tops_m[is_occupied]


def _highest_leaves(
    octree_map: OctreeMap, odom_T_vehicle: NDArray[np.float64], view: BirdView
) -> NDArray[np.float64]:
    """The height of the highest occupied leaf over each (x, y), within the view's band."""
    # middles of the leaves along x, y and z, seen from the vehicle (3, side)
    middles_m = (np.arange(octree_map.octree.side) + 0.5) * octree_map.leaf_m + (
        octree_map.corner_m - odom_T_vehicle[:3, 3]
    )[:, None]
    # their components along the upward axis, whose sum is the height of a leaf (side, side, side)
    x_m, y_m, z_m = middles_m * view.up(odom_T_vehicle)[:, None]
    heights_m = x_m[:, None, None] + y_m[:, None] + z_m
    is_occupied = octree_map.log_odds > log_odds(view.occupied)
    is_in_band = (heights_m >= view.low_m) & (heights_m < view.high_m)
    return np.asarray(np.where(is_occupied & is_in_band, heights_m, -np.inf).max(axis=2))


def _corners(
    octree_map: OctreeMap,
    odom_T_vehicle: NDArray[np.float64],
    columns: NDArray[np.int64],
    node_m: float,
) -> NDArray[np.float64]:
    """The corners (n, 4, 2) of columns of nodes in the vehicle's frame, in metres."""
    corners = columns[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    from_vehicle_m = octree_map.corner_m[:2] + corners * node_m - odom_T_vehicle[:2, 3]
    yaw_rad = math.atan2(odom_T_vehicle[1, 0], odom_T_vehicle[0, 0])
    c = math.cos(yaw_rad)
    s = math.sin(yaw_rad)
    return np.asarray(from_vehicle_m @ np.array([[c, -s], [s, c]]))


def _cloud(
    axis: Axes, points_m: NDArray[np.floating], half_m: float, heights: Normalize, dot_size: float
) -> None:
    """Draw the points (n, 3) at most `half_m` from the robot, higher ones over lower ones."""
    near_m = points_m[(np.abs(points_m[:, :2]) < half_m).all(axis=1)]
    every = max(math.ceil(len(near_m) / MOST_POINTS), 1)
    drawn_m = near_m[::every]
    x_m, y_m, z_m = drawn_m[np.argsort(drawn_m[:, 2], kind="stable")].T
    style: Any = {"cmap": COLOURS, "norm": heights, "linewidths": 0, "rasterized": True}
    axis.scatter(-y_m, x_m, dot_size, z_m, **style)


def _robot(axis: Axes, half_m: float, **marker: Any) -> None:
    """Draw the robot in the middle of a panel that reaches `half_m` to each side."""
    axis.plot(0, 0, "^", color=ROBOT, **marker)
    axis.set(xlim=(-half_m, half_m), ylim=(-half_m, half_m), aspect="equal", xticks=[], yticks=[])
