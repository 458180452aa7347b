"""Slides: other poses, along the street or turned on the spot, that look right too (METHODS 9.4).

Rows of houses, colonnades and avenues repeat themselves: a query can be registered a few houses
farther on as well as where it is. A crossing with equal corners look similar in four directions.

In: a query's walls and a pose. Out: the poses elsewhere at which its walls fit best, and how much
better they fit at the pose itself. To find them, the walls are scored at all offsets on the charts
(walls drawn from above) of the submaps around: at the heading of the pose, and on the nearest
submap at TURNS_DEG from that too.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose, yaw
from pipeline.posing.targets import APART_M, Targets
from pipeline.posing.walls import Walls

FAR_M = 40.0
"""Slid copies are searched for in submaps up to this far from a pose."""
SLID_M = 3.0
"""A fit nearer than this to the pose is no copy, but the pose itself."""
TURNS_DEG = (86.0, 90.0, 94.0, 176.0, 180.0, 184.0, 266.0, 270.0, 274.0)
"""Further headings to try, relative to that of the pose: quarter turns, and a little off them."""
WIDEST_MARGIN = 0.3
"""Leads are cut off at plus and minus this: a larger one says no more."""
COPIES = 3
"""Largest number of aliases."""


class Copy(NamedTuple):
    """A pose elsewhere at which the walls of a query fit well."""

    score: float
    """How well, as `Walls.scores` measures it."""
    row: int
    """The training submap whose walls they fit."""
    target_T_query: NDArray[np.float64]
    """(4, 4) the pose in that submap's frame."""


@dataclass(frozen=True)
class Aliases:
    """The best fits of a query's walls elsewhere, and how far the pose leads them."""

    margin: float
    """The score of the walls at the pose, less that of the best copy; 0 if there is no submap near
    enough to say."""
    copies: tuple[Copy, ...]
    """The best copies, the best first, each at least APART_M from those before it."""


def aliases(
    walls: Walls,
    targets: Targets,
    middles: NDArray[np.float64],
    world_T_query: NDArray[np.float64],
    left_out: NDArray[np.bool_],
) -> Aliases:
    """Find the slide of a query at a pose (4, 4).

    The query's walls are given by their `middles` (n, 2), see Walls.middles; training submaps
    `left_out` (row,) are ignored.
    """
    # The submaps near the pose, the nearest first, and the pose in the frame of each.
    anchors_m = targets.world_T_anchor[:, :2, 3]
    away_m = np.where(left_out, np.inf, np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1))
    near_rows = np.argsort(away_m, kind="stable")[: np.count_nonzero(away_m < FAR_M)]
    rows = near_rows[_spaced(anchors_m[near_rows])]
    targets_T_query = np.linalg.inv(targets.world_T_anchor[rows]) @ world_T_query
    headings_rad = yaw(targets_T_query)

    # The distance (submap, x, y) of each offset that is scored from the pose, on each chart.
    offsets_m = (np.arange(2 * walls.offset_cells + 1) - walls.offset_cells) * walls.cell_m
    x_m, y_m = targets_T_query[:, :2, 3].T[:, :, None, None]  # (submap, 1, 1) each
    distances_m = np.hypot(offsets_m[:, None] - x_m, offsets_m - y_m)

    # The score of the walls at the pose itself, and the best fit elsewhere in each submap.
    score_at_pose = -np.inf
    fits: list[_Fit] = []
    for row, heading_rad, distance_m in zip(
        rows.tolist(), headings_rad.tolist(), distances_m, strict=True
    ):
        turns_deg = (0.0, *TURNS_DEG) if row == near_rows[0] else (0.0,)
        for turn_deg in turns_deg:
            turned_rad = heading_rad + np.deg2rad(turn_deg)
            scores = walls.scores(targets.chart(walls, row), middles, turned_rad)
            if not turn_deg:
                # Offsets near the pose are the pose itself. Those between are neither.
                near_scores = scores[distance_m < SLID_M / 2]
                score_at_pose = max(score_at_pose, float(near_scores.max(initial=-np.inf)))
                scores = np.where(distance_m >= SLID_M, scores, -np.inf)
            i, j = np.unravel_index(scores.argmax(), scores.shape)
            fits.append(
                _Fit(
                    score=float(scores[i, j]),
                    row=row,
                    x_m=offsets_m[i],
                    y_m=offsets_m[j],
                    heading_rad=turned_rad,
                )
            )

    # The best of them, spaced out.
    fits = sorted((fit for fit in fits if np.isfinite(fit.score)), key=lambda fit: -fit.score)
    if not fits or not np.isfinite(score_at_pose):
        return Aliases(0.0, ())
    margin = float(np.clip(score_at_pose - fits[0].score, -WIDEST_MARGIN, WIDEST_MARGIN))
    world_xy_m = np.array([fit.world_xy_m(targets) for fit in fits])
    return Aliases(margin, tuple(fits[i].copy() for i in _spaced(world_xy_m)[:COPIES]))


class _Fit(NamedTuple):
    """The best fit of a query's walls in one submap at one heading."""

    score: float
    row: int
    x_m: float
    y_m: float
    """The query's position in the submap's frame."""
    heading_rad: float
    """The query's heading in the submap's frame."""

    def world_xy_m(self, targets: Targets) -> NDArray[np.float64]:
        """The query's position (2,) in the world."""
        return np.asarray(targets.world_T_anchor[self.row] @ (self.x_m, self.y_m, 0.0, 1.0))[:2]

    def copy(self) -> Copy:
        """The fit as a pose."""
        xyz_m = np.array([[self.x_m, self.y_m, 0.0]])
        roll_pitch_yaw = np.array([[0.0, 0.0, self.heading_rad]])
        return Copy(self.score, self.row, pose(xyz_m, roll_pitch_yaw)[0])


def _spaced(xy_m: NDArray[np.float64]) -> list[int]:
    """The rows of positions (n, 2) to keep, in order: each at least APART_M from those before."""
    is_near = np.linalg.norm(xy_m[:, None] - xy_m, axis=2) < APART_M
    chosen: list[int] = []
    is_free = np.ones(len(xy_m), bool)
    for row in range(len(xy_m)):
        if is_free[row]:
            chosen.append(row)
            is_free &= ~is_near[row]
    return chosen
