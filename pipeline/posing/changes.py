"""Changes: which submaps of a map are contradicted by later scans of the same spot (METHODS 11.3).

A wall is gone where a later scan sees through it; it was built where a later scan has one and the
map saw through. Only what at least two scans tell counts, for a parked lorry hides a wall from one
spot only.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.frames import Poses
from pipeline.posing.registration import Points, moved
from pipeline.posing.targets import Targets
from pipeline.posing.walls import SEEN_THROUGH, Chart, Walls

NEAR_M = 5.0
"""Scans nearer to a submap's anchor than this can contradict it."""
AGREEING = 2
"""Least number of scans that must contradict a submap."""
USUAL = 0.99
"""A submap is changed if it is contradicted more than this share of the pairs of one day, which
show what is no change."""


def contradicted(
    targets: Targets, walls: Walls, scans: Sequence[Points], world_T_scan: Poses, usual_share: float
) -> dict[int, int]:
    """Map each submap that scans (n,) contradict to the scan nearest to it.

    AGREEING scans must contradict it by more than `usual_share`.
    """
    tree = KDTree(world_T_scan[:, :2, 3])
    changed = {}
    walls_m = [walls.of(points_m) for points_m in scans]
    charts = [walls.chart(points_m) for points_m in walls_m]
    for row, world_T_anchor in enumerate(targets.world_T_anchor):
        near = tree.query_ball_point(world_T_anchor[:2, 3], NEAR_M)
        if len(near) < AGREEING:
            continue
        steps = {scan: np.linalg.inv(world_T_anchor) @ world_T_scan[scan] for scan in near}
        old_m = walls.of(targets.points_m(row))
        shares = [
            contradiction(
                walls, (targets.chart(walls, row), old_m), (charts[scan], walls_m[scan]), step
            )
            for scan, step in steps.items()
        ]
        if sum(share > usual_share for share in shares) >= AGREEING:
            changed[row] = min(near, key=lambda scan: float(np.linalg.norm(steps[scan][:2, 3])))
    return changed


def usual_contradiction(targets: Targets, walls: Walls) -> float:
    """The contradiction that USUAL of the pairs of neighbouring submaps of a map stay below.

    It is 1 where there is no such pair.
    """
    tree = KDTree(targets.world_T_anchor[:, :2, 3])
    shares = []
    for row, other_row in tree.query_pairs(NEAR_M, output_type="ndarray").tolist():
        step = np.linalg.inv(targets.world_T_anchor[row]) @ targets.world_T_anchor[other_row]
        old, new = (
            (targets.chart(walls, side), walls.of(targets.points_m(side)))
            for side in (row, other_row)
        )
        shares.append(contradiction(walls, old, new, step))
    return float(np.quantile(shares, USUAL)) if shares else 1.0


def contradiction(
    walls: Walls,
    old: tuple[Chart, Points],
    new: tuple[Chart, Points],
    old_T_new: NDArray[np.float64],
) -> float:
    """The share of walls that one of two submaps has and the other saw through.

    The old and the new submap are each a chart and the points (n, 3) of its walls; it is the larger
    of the shares of both.
    """
    gone = _seen_through(walls, new[0], moved(np.asarray(np.linalg.inv(old_T_new)), old[1]))
    return max(gone, _seen_through(walls, old[0], moved(old_T_new, new[1])))


def _seen_through(walls: Walls, chart: Chart, walls_m: Points) -> float:
    """The share of walls (n, 3) in the chart's frame that it saw through.

    Walls where the chart is unknown do not count.
    """
    cells = np.floor(walls.middles(walls_m)).astype(np.int64) + walls.half_width_cells
    values = chart[0][
        tuple(cells[((cells >= 0) & (cells < 2 * walls.half_width_cells)).all(axis=1)].T)
    ]
    known_count = np.count_nonzero(values)
    return float(np.count_nonzero(values == SEEN_THROUGH) / known_count) if known_count else 0.0
