"""Perceptual aliases: other poses, along the street or turned on the spot, that fit as well.

Rows of houses, colonnades and avenues repeat themselves: a query can be registered a few houses
farther on as well as where it is. A crossing with equal corners looks the same in four directions
(METHODS 9.4).

In: a query's walls and a pose. Out: the poses elsewhere at which the walls fit best, and the margin
by which they fit better at the pose itself. `aliases` finds those near the pose: the walls are
scored at all offsets on the charts (walls drawn from above) of the submaps around it, at the pose's
heading, and on the nearest submap also at headings turned by TURNS_DEG. `aliases_in_map` adds
those at which the walls fit in the whole map.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose, yaw
from pipeline.posing.targets import APART_M, Targets
from pipeline.posing.walls import Walls
from pipeline.posing.whole_map import Slid

FAR_M = 40.0
"""Aliases are searched for in the submaps nearer to the pose than this."""
ALIAS_FROM_M = 3.0
"""A fit nearer to the pose than this is not an alias, but the pose itself."""
TURNS_DEG = (86.0, 90.0, 94.0, 176.0, 180.0, 184.0, 266.0, 270.0, 274.0)
"""Further headings to try, relative to the pose's: quarter turns, and 4° to each side of them."""
WIDEST_MARGIN = 0.3
"""Margins are clipped to plus and minus this: a larger one is no stronger evidence."""
MOST_ALIASES = 3
"""Largest number of aliases of a pose."""


class Alias(NamedTuple):
    """A pose elsewhere at which the walls of a query fit well."""

    margin: float
    """How much better the walls fit at the pose itself than here."""
    row: int
    """The training submap whose walls the query's walls fit."""
    target_T_query: NDArray[np.float64]
    """(4, 4) the pose in that submap's frame."""


@dataclass(frozen=True)
class Aliases:
    """The aliases of a pose, and the margin of the pose over the best of them."""

    margin: float
    """The score of the walls at the pose, minus the score of the best alias, within
    ±WIDEST_MARGIN; 0 if no submap is near enough to compute the scores."""
    ranked: tuple[Alias, ...]
    """The MOST_ALIASES best aliases, the best first, at least APART_M apart."""


def aliases(
    walls: Walls,
    targets: Targets,
    middles: NDArray[np.float64],
    world_T_query: NDArray[np.float64],
    left_out: NDArray[np.bool_],
) -> Aliases:
    """Find the aliases of a query's pose (4, 4).

    The query's walls are given by their `middles` (n, 2), see Walls.middles. The training submaps
    that are True in `left_out` (row,) are ignored.
    """
    # The submaps near the pose, the nearest first, and the pose in the frame of each.
    anchors_m = targets.world_T_anchor[:, :2, 3]
    away_m = np.where(left_out, np.inf, np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1))
    near_rows = np.argsort(away_m, kind="stable")[: np.count_nonzero(away_m < FAR_M)]
    apart_m = 2 * walls.offset_m if targets.is_map else APART_M
    rows = near_rows[_spaced(anchors_m[near_rows], apart_m)]
    targets_T_query = np.linalg.inv(targets.world_T_anchor[rows]) @ world_T_query
    headings_rad = yaw(targets_T_query)

    # The distance (submap, x, y) from the pose to each scored offset, on each chart.
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
                # Offsets near the pose are the pose itself; those up to ALIAS_FROM_M are neither.
                near_scores = scores[distance_m < ALIAS_FROM_M / 2]
                score_at_pose = max(score_at_pose, float(near_scores.max(initial=-np.inf)))
                scores = np.where(distance_m >= ALIAS_FROM_M, scores, -np.inf)
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

    # The best fits, at least APART_M apart.
    fits = sorted((fit for fit in fits if np.isfinite(fit.score)), key=lambda fit: -fit.score)
    if not fits or not np.isfinite(score_at_pose):
        return Aliases(0.0, ())
    margin = float(np.clip(score_at_pose - fits[0].score, -WIDEST_MARGIN, WIDEST_MARGIN))
    world_xy_m = np.array([fit.world_xy_m(targets) for fit in fits])
    ranked = [fits[i].alias(score_at_pose) for i in _spaced(world_xy_m)[:MOST_ALIASES]]
    return Aliases(margin, tuple(ranked))


def aliases_in_map(
    slid: Slid,
    targets: Targets,
    world_T_query: NDArray[np.float64],
    left_out: NDArray[np.bool_],
    near: Aliases,
    least_margin: float,
) -> Aliases:
    """The aliases of a pose (4, 4) in the whole map, given those `near` it (see `aliases`).

    The margin is the smaller of both. Fits elsewhere in the map count as aliases if the pose's
    margin over them is below `least_margin`, and if they are APART_M or more from the near aliases.
    """
    score_at_pose = slid.score_at(world_T_query)
    rows = slid.elsewhere(world_T_query, ALIAS_FROM_M, score_at_pose)
    if not len(rows):
        return near
    margins = score_at_pose - slid.fits.scores[rows]
    ranked = list(near.ranked)
    taken_m = [_world_xy_m(targets, alias.row, alias.target_T_query) for alias in ranked]
    for fit, margin in zip(rows.tolist(), margins.tolist(), strict=True):
        if margin >= least_margin or len(ranked) >= len(near.ranked) + MOST_ALIASES:
            break
        xy_m = slid.fits.xy_m[fit]
        if all(np.linalg.norm(xy_m - taken) >= APART_M for taken in taken_m):
            for row, guess in targets.guesses(
                xy_m[None], slid.fits.heading_deg[None, fit], left_out
            ):
                ranked.append(Alias(margin, row, guess))
                taken_m.append(xy_m)
    margin = float(np.clip(margins[0], -WIDEST_MARGIN, WIDEST_MARGIN))
    return Aliases(min(margin, near.margin) if near.ranked else margin, tuple(ranked))


def _world_xy_m(
    targets: Targets, row: int, target_T_query: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The position (2,) in the world of a pose (4, 4) in a submap's frame."""
    return np.asarray((targets.world_T_anchor[row] @ target_T_query)[:2, 3])


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

    def alias(self, score_at_pose: float) -> Alias:
        """The fit as an alias."""
        xyz_m = np.array([[self.x_m, self.y_m, 0.0]])
        roll_pitch_yaw = np.array([[0.0, 0.0, self.heading_rad]])
        return Alias(score_at_pose - self.score, self.row, pose(xyz_m, roll_pitch_yaw)[0])


def _spaced(xy_m: NDArray[np.float64], apart_m: float = APART_M) -> list[int]:
    """The rows of positions (n, 2) to keep, in order: each is `apart_m` or more from the rows kept
    before it."""
    is_near = np.linalg.norm(xy_m[:, None] - xy_m, axis=2) < apart_m
    chosen: list[int] = []
    is_free = np.ones(len(xy_m), bool)
    for row in range(len(xy_m)):
        if is_free[row]:
            chosen.append(row)
            is_free &= ~is_near[row]
    return chosen
