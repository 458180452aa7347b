"""Slides: where else along its street, or turned on its place, a pose would look right (METHODS 9.4).

Rows of houses, colonnades and avenues repeat themselves: a query registers a few houses farther on as well as where it is; and a
crossing of equal corners looks alike in four directions. So its walls are laid on the charts of all training submaps around at
the heading of a pose, and on the nearest at right angles to it too; the best fit elsewhere is named.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import pose, yaw
from pipeline.posing.targets import APART_M, Targets
from pipeline.posing.walls import Walls

FAR_M = 40.0
"""Slid copies are looked for so far around a pose."""
SLID_M = 3.0
"""A fit nearer than this to the pose is the pose's own."""
TURNS_DEG = (86.0, 90.0, 94.0, 176.0, 180.0, 184.0, 266.0, 270.0, 274.0)
"""Headings besides, from that of the pose."""
WIDEST_LEAD = 0.3
"""Leads are cut at this, either way: a street without another wall says no more."""


@dataclass(frozen=True)
class Slide:
    """The best fit of walls elsewhere."""

    lead: float
    """The score of the walls at the pose, less that of this fit; 0 where no submap near enough can tell."""
    row: int
    """The training submap that it was found in; −1 of none."""
    target_T_query: NDArray[np.float64]
    """(4, 4) in that submap's frame."""


def slide(
    walls: Walls, targets: Targets, middles: NDArray[np.float64], world_T_query: NDArray[np.float64], left_out: NDArray[np.bool_]
) -> Slide:
    """The slide of a query, of whose walls these are the `middles` (Walls.middles), at a pose (4, 4)."""
    anchors_m = targets.world_T_anchor[:, :2, 3]
    away_m = np.where(left_out, np.inf, np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1))
    around = np.argsort(away_m, kind="stable")[: np.count_nonzero(away_m < FAR_M)]
    offsets_m = (np.arange(2 * walls.reach + 1) - walls.reach) * walls.cell_m
    own, best, row, there = -np.inf, -np.inf, -1, np.eye(4)
    for other in around[_spaced(anchors_m[around])].tolist():
        target_T_query = np.linalg.inv(targets.world_T_anchor[other]) @ world_T_query
        heading = float(yaw(target_T_query[None])[0])
        off_m = np.hypot(offsets_m[:, None] - target_T_query[0, 3], offsets_m - target_T_query[1, 3])
        for turn_deg in (0.0, *(TURNS_DEG if other == around[0] else ())):
            turned = heading + np.deg2rad(turn_deg)
            scores = walls.scores(targets.chart(walls, other), middles, turned)
            if not turn_deg:
                own = max(own, float(scores[off_m < SLID_M / 2].max(initial=-np.inf)))
                scores = np.where(off_m >= SLID_M, scores, -np.inf)
            x, y = np.unravel_index(scores.argmax(), scores.shape)
            if scores[x, y] > best:
                best, row = float(scores[x, y]), other
                there = pose(np.array([[offsets_m[x], offsets_m[y], 0.0]]), np.array([[0.0, 0.0, turned]]))[0]
    if not np.isfinite(best) or not np.isfinite(own):
        return Slide(0.0, -1, there)
    return Slide(float(np.clip(own - best, -WIDEST_LEAD, WIDEST_LEAD)), row, there)


def _spaced(xy_m: NDArray[np.float64]) -> list[int]:
    """Of positions (n, 2) those, in their order, that lie APART_M or more from each one kept before."""
    near = np.linalg.norm(xy_m[:, None] - xy_m, axis=2) < APART_M
    kept: list[int] = []
    free = np.ones(len(xy_m), bool)
    for number in range(len(xy_m)):
        if free[number]:
            kept.append(number)
            free &= ~near[number]
    return kept
