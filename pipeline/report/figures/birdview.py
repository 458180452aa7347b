"""Fig. 2 of paper 2: a scan, the octree's occupied leaves and nodes, and the bird-view.

All are seen from above, with the robot's front up.
"""

import math

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.mapping.octree import OctreeMap, log_odds
from pipeline.report.figures.style import WIDTH_IN, figure, styled
from pipeline.views.birdview import BirdView

COLOURS = "viridis"
COARSER = 2  # levels above the leaves of the panel that shows inner nodes
POINTS = 30_000  # shown at most, evenly spread over the scan
ROBOT = "#D55E00"


@styled
def bird_view(
    points_m: NDArray[np.floating],
    octree_map: OctreeMap,
    odom_T_vehicle: NDArray[np.float64],
    view: BirdView,
) -> Figure:
    """The newest scan (n, 3), its map's highest leaves and nodes, and the bird-view of heading 0.

    The scan is in the vehicle frame; leaves and nodes are those in the view's band of heights.
    """
    octree = octree_map.octree
    heights = Normalize(0.0, view.high_m)
    half_m = octree.edge_m / 2
    fig = figure(WIDTH_IN, 2.7, "From a scan to its bird-view")
    scan, leaves, nodes, image = axes = fig.subplots(1, 4)
    near = points_m[(np.abs(points_m[:, :2]) < half_m).all(axis=1)]
    near = near[:: -(-len(near) // POINTS) or 1]
    near = near[np.argsort(near[:, 2], kind="stable")]
    scan.scatter(
        -near[:, 1],
        near[:, 0],
        0.15,
        near[:, 2],
        cmap=COLOURS,
        norm=heights,
        linewidths=0,
        rasterized=True,
    )
    scan.set_title(f"scan, {len(points_m):,} points")
    for axis, name, depth in (
        (leaves, "leaves", octree.depth),
        (nodes, "nodes", octree.depth - COARSER),
    ):
        corners_m, tops_m = tops(octree_map, odom_T_vehicle, view, depth)
        squares = PolyCollection(
            [*np.stack([-corners_m[..., 1], corners_m[..., 0]], axis=-1)],
            cmap=COLOURS,
            norm=heights,
        )
        squares.set(array=tops_m, linewidth=0, rasterized=True)
        axis.add_collection(squares)
        axis.set_title(f"occupied {name} of {octree.edge_m / 2**depth:.2f} m")
    share = view.draw(octree_map, odom_T_vehicle)[0]
    image.imshow(
        share,
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=(-half_m, half_m, -half_m, half_m),
        interpolation="nearest",
    )
    image.set_title(f"bird-view, {view.side_px} × {view.side_px}")
    for axis in axes:
        axis.plot(0, 0, "^", color=ROBOT, ms=3.5, mew=0)
        axis.set(
            xlim=(-half_m, half_m), ylim=(-half_m, half_m), aspect="equal", xticks=[], yticks=[]
        )
        axis.spines[:].set_visible(True)
    scale = fig.colorbar(
        ScalarMappable(heights, COLOURS),
        ax=axes,
        location="bottom",
        shrink=0.35,
        aspect=35,
        pad=0.03,
    )
    scale.set_label(
        f"height in metres; each panel shows {2 * half_m:g} m × {2 * half_m:g} m around the robot"
    )
    return fig


def tops(
    octree_map: OctreeMap, odom_T_vehicle: NDArray[np.float64], view: BirdView, depth: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes of a depth with occupied leaves in the view's band of heights.

    Gives their corners (n, 4, 2) in the vehicle frame, and the height of the highest leaf (n,).
    """
    octree = octree_map.octree
    from_robot_m = (np.arange(octree.side) + 0.5) * octree_map.leaf_m + (
        octree_map.corner_m - odom_T_vehicle[:3, 3]
    )[:, None]
    x_m, y_m, z_m = from_robot_m * view.up(odom_T_vehicle)[:, None]
    above_m = x_m[:, None, None] + y_m[:, None] + z_m
    occupied = (
        (octree_map.log_odds > log_odds(view.occupied))
        & (above_m >= view.low_m)
        & (above_m < view.high_m)
    )
    leaves = np.where(occupied, above_m, -np.inf).max(axis=2)
    highest = leaves.reshape(2**depth, -1, 2**depth, octree.side // 2**depth).max(axis=(1, 3))
    column = np.argwhere(np.isfinite(highest))
    square = column[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    around_m = octree_map.corner_m[:2] + square * (octree.edge_m / 2**depth) - odom_T_vehicle[:2, 3]
    yaw_rad = math.atan2(odom_T_vehicle[1, 0], odom_T_vehicle[0, 0])
    c = math.cos(yaw_rad)
    s = math.sin(yaw_rad)
    return around_m @ np.array([[c, -s], [s, c]]), highest[tuple(column.T)]
