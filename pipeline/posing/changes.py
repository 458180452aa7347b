"""Changes: which submaps of a map are contradicted by later scans of the same place (METHODS 11.3).

In: a map, and scans of a later day with their poses. Out: the submaps that have changed, each with
the scan that may replace it. A wall was torn down if a later scan sees through it, and built if a
later scan meets a wall where the map's scan saw through. At least two scans must contradict a
submap, since a parked lorry hides a wall from one position only.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.frames import Poses, transformed
from pipeline.mapping.wall_chart import SEEN_THROUGH, Chart
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets
from pipeline.posing.walls import Walls

NEAR_M = 5.0
"""Only scans nearer to a submap's anchor than this can contradict the submap."""
AGREEING = 2
"""Least number of scans that must contradict a submap."""
USUAL_QUANTILE = 0.99
"""A contradiction counts if it exceeds this quantile of the contradictions between submaps of one
day, between which nothing has changed."""


def contradicted(
    targets: Targets, walls: Walls, scans: Sequence[Points], world_T_scan: Poses, usual_share: float
) -> dict[int, int]:
    """Return the submaps that the scans (n,) contradict, each with the scan nearest to it.

    A submap is contradicted if AGREEING or more scans contradict it by more than `usual_share`, the
    result of `usual_contradiction`. Scans are points (m, 3) in their own frames.
    """
    tree = KDTree(world_T_scan[:, :2, 3])
    scan_walls_m = [walls.of(points_m) for points_m in scans]
    scan_charts = [WallsFromAbove(walls.chart(walls_m), walls_m) for walls_m in scan_walls_m]
    changed = {}
    for row, world_T_anchor in enumerate(targets.world_T_anchor):
        near_scans = tree.query_ball_point(world_T_anchor[:2, 3], NEAR_M)
        if len(near_scans) < AGREEING:
            continue
        submap = _from_above(targets, walls, row)
        distances_m = {}
        contradicting_count = 0
        for scan in near_scans:
            anchor_T_scan = np.linalg.inv(world_T_anchor) @ world_T_scan[scan]
            distances_m[scan] = float(np.linalg.norm(anchor_T_scan[:2, 3]))
            share = contradiction(walls, submap, scan_charts[scan], anchor_T_scan)
            contradicting_count += share > usual_share
        if contradicting_count >= AGREEING:
            changed[row] = min(near_scans, key=lambda scan: distances_m[scan])
    return changed


def usual_contradiction(targets: Targets, walls: Walls) -> float:
    """The USUAL_QUANTILE of the contradictions between neighbouring submaps of a map.

    It is 1 if no two submaps are neighbours.
    """
    tree = KDTree(targets.world_T_anchor[:, :2, 3])
    shares = []
    for row, other_row in tree.query_pairs(NEAR_M, output_type="ndarray").tolist():
        row_T_other = np.linalg.inv(targets.world_T_anchor[row]) @ targets.world_T_anchor[other_row]
        submap = _from_above(targets, walls, row)
        other_submap = _from_above(targets, walls, other_row)
        shares.append(contradiction(walls, submap, other_submap, row_T_other))
    return float(np.quantile(shares, USUAL_QUANTILE)) if shares else 1.0


class WallsFromAbove(NamedTuple):
    """The walls of a submap or scan: as points, and drawn from above."""

    chart: Chart
    """The walls drawn from above."""
    walls_m: Points
    """(n, 3) points of walls in the frame of the submap or scan."""


def _from_above(targets: Targets, walls: Walls, row: int) -> WallsFromAbove:
    """The walls of a submap of the map."""
    return WallsFromAbove(targets.chart(walls, row), walls.of(targets.points_m(row)))


def contradiction(
    walls: Walls, old: WallsFromAbove, new: WallsFromAbove, old_T_new: NDArray[np.float64]
) -> float:
    """The share of walls that one of two submaps has and the other saw through.

    It is the larger of two shares: of the old walls that were torn down, and of the new walls that
    were built.
    """
    new_T_old = np.asarray(np.linalg.inv(old_T_new))
    torn_down = _seen_through(walls, new.chart, transformed(new_T_old, old.walls_m))
    built = _seen_through(walls, old.chart, transformed(old_T_new, new.walls_m))
    return max(torn_down, built)


def _seen_through(walls: Walls, chart: Chart, walls_m: Points) -> float:
    """The share of walls (n, 3), in the frame of a chart, that the chart saw through.

    Walls in unknown cells of the chart do not count.
    """
    cells = np.floor(walls.middles(walls_m)).astype(np.int64) + walls.half_width_cells
    is_inside = ((cells >= 0) & (cells < 2 * walls.half_width_cells)).all(axis=1)
    values = chart[0][tuple(cells[is_inside].T)]
    known_count = np.count_nonzero(values)
    return float(np.count_nonzero(values == SEEN_THROUGH) / known_count) if known_count else 0.0
