"""A hall of 20 by 12 m made by hand, and the sweeps of a level laser in it."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.formats import nav2_map
from pipeline.formats.nav2_map import GridMap
from pipeline.level.field import Field
from pipeline.level.level_map import Drawing
from pipeline.level.validation import Sweeps

WALLS = (
    *((0, 0, 20, 0), (20, 0, 20, 12), (20, 12, 0, 12), (0, 12, 0, 0)),  # the outer walls
    *((7, 0, 7, 4), (7, 6, 7, 12), (7, 6, 12, 6), (14, 12, 14, 8)),  # rooms of different shapes
    *((2, 8, 3, 8), (3, 8, 3, 9.5), (17, 2, 18, 2), (18, 2, 18, 5)),  # furniture
)
"""x, y of the start and the end of each wall, in metres."""
DRIVEN = ((1.5, 1.5), (5, 2), (5.5, 5), (9, 5), (13, 4), (16, 4), (16, 9), (12.5, 9), (12.5, 5))
"""Corners of the path driven through it."""


def sweep(
    x_m: float,
    y_m: float,
    heading_rad: float,
    beams: int = 180,
    noise: np.random.Generator | None = None,
    walls: tuple[tuple[float, ...], ...] = WALLS,
) -> NDArray[np.float64]:
    """The hits (n, 2) of a half circle of beams, in metres in the robot's frame.

    The robot stands at x, y and looks along the heading; `noise` adds 2 cm to each range.
    """
    angles = heading_rad + np.linspace(-np.pi / 2, np.pi / 2, beams)
    ranges_m = np.full(beams, np.inf)
    beam = np.column_stack([np.cos(angles), np.sin(angles)])
    for x0, y0, x1, y1 in walls:
        wall = np.array([x1 - x0, y1 - y0])
        to_wall = np.array([x0 - x_m, y0 - y_m])
        # solve (x, y) + range beam = (x0, y0) + share wall by Cramer's rule
        determinant = beam[:, 0] * wall[1] - beam[:, 1] * wall[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = (to_wall[0] * wall[1] - to_wall[1] * wall[0]) / determinant
            share = (to_wall[0] * beam[:, 1] - to_wall[1] * beam[:, 0]) / determinant
        hits = (share >= 0) & (share <= 1) & (range_m > 0)
        ranges_m[hits] = np.minimum(ranges_m[hits], range_m[hits])
    if noise is not None:
        ranges_m = ranges_m + noise.normal(0, 0.02, beams)
    seen = np.isfinite(ranges_m)
    seen_m = ranges_m[seen]
    local = angles[seen] - heading_rad
    return np.column_stack([seen_m * np.cos(local), seen_m * np.sin(local)])


def pose(x_m: float, y_m: float, heading_rad: float) -> NDArray[np.float64]:
    """The pose (4, 4) of a robot on the floor."""
    world_T_robot = np.eye(4)
    cos = np.cos(heading_rad)
    sin = np.sin(heading_rad)
    world_T_robot[:2, :2] = [[cos, -sin], [sin, cos]]
    world_T_robot[:2, 3] = x_m, y_m
    return world_T_robot


def drawing(sweeps: Sweeps, cell_m: float | None = None) -> Drawing:
    """The drawing of all sweeps of a drive."""
    hits = [sweeps.points(row) for row in range(len(sweeps.world_T_sweep))]
    return Drawing.of(hits, sweeps.world_T_sweep, cell_m=cell_m)


@cache
def field() -> Field:
    """The map of the whole drive."""
    return Field.of(drawing(drive()).level_map())


def drive(
    corners: tuple[tuple[float, float], ...] = DRIVEN, step_m: float = 0.5, seed: int = 0
) -> Sweeps:
    """Sweeps along a path, with exact poses, and odometry that turns by 2° too much each metre."""
    poses = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        length_m = float(np.hypot(x1 - x0, y1 - y0))
        heading = float(np.arctan2(y1 - y0, x1 - x0))
        for share in np.arange(0, length_m, step_m) / length_m:
            poses.append((x0 + share * (x1 - x0), y0 + share * (y1 - y0), heading))
    noise = np.random.default_rng(seed)
    hits = [sweep(*place, noise=noise) for place in poses]
    world_T_sweep = np.array([pose(*place) for place in poses])
    odom_T_sweep = [np.eye(4)]
    for before, after in pairwise(world_T_sweep):
        step = np.linalg.inv(before) @ after
        odom_T_sweep.append(odom_T_sweep[-1] @ step @ pose(0, 0, np.deg2rad(2) * step_m))
    return Sweeps(lambda row: hits[row], world_T_sweep, np.array(odom_T_sweep))


def map_of_hall(folder: Path) -> Path:
    """Write a Nav2 map of the hall, by a drive through it; returns its yaml."""
    level_map = drawing(drive()).level_map()
    path = folder / "hall.yaml"
    nav2_map.write(path, GridMap(level_map.occupancy, level_map.cell_m, level_map.origin))
    return path
