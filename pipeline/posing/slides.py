"""Slides: other poses, along the street or turned on the spot, that look right too (METHODS 9.4).

Rows of houses, colonnades and avenues repeat themselves: a query registers a few houses farther on
as well as where it is; and a crossing of equal corners looks alike in four directions. So its walls
are laid on the charts of all training submaps around at the heading of a pose, and on the nearest
at right angles to it too; the best fit elsewhere is named.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.posing.targets import APART_M, Targets
from pipeline.posing.walls import Walls

FAR_M = 40.0
"""Slid copies are looked for this far around a pose."""
SLID_M = 3.0
"""A fit nearer than this to the pose is the pose's own."""
TURNS_DEG = (86.0, 90.0, 94.0, 176.0, 180.0, 184.0, 266.0, 270.0, 274.0)
"""Further headings to try, relative to that of the pose."""
WIDEST_LEAD = 0.3
"""Leads are cut at this, either way: a street without another wall says no more."""
COPIES = 3
"""Slid copies at most."""


class Copy(NamedTuple):
    """A pose elsewhere at which the walls of a query fit well."""

    score: float
    row: int
    """The training submap that it was found in."""
    target_T_query: NDArray[np.float64]
    """(4, 4) in that submap's frame."""


@dataclass(frozen=True)
class Slide:
    """The best fits of a query's walls elsewhere, and how far the pose leads them."""

    lead: float
    """The score of the walls at the pose, less that of the best copy; 0 where no submap near enough
    can tell."""
    copies: tuple[Copy, ...]
    """The best first, each APART_M or more from those before it."""


def slide(
    walls: Walls,
    targets: Targets,
    middles: NDArray[np.float64],
    world_T_query: NDArray[np.float64],
    left_out: NDArray[np.bool_],
) -> Slide:
    """Find the slide of a query at a pose (4, 4).

    Its walls are given by their `middles` (Walls.middles).
    """
    anchors_m = targets.world_T_anchor[:, :2, 3]
    away_m = np.where(left_out, np.inf, np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1))
    near_rows = np.argsort(away_m, kind="stable")[: np.count_nonzero(away_m < FAR_M)]
    offsets_m = (np.arange(2 * walls.offset_cells + 1) - walls.offset_cells) * walls.cell_m
    own_score = -np.inf
    fits: list[tuple[float, int, float, float, float]] = []
    rows = near_rows[_spaced(anchors_m[near_rows])]
    targets_T_query = np.linalg.inv(targets.world_T_anchor[rows]) @ world_T_query
    headings = np.arctan2(targets_T_query[:, 1, 0], targets_T_query[:, 0, 0])
    x_m, y_m = targets_T_query[:, :2, 3].T[:, :, None, None]
    every_off_m = np.hypot(offsets_m[:, None] - x_m, offsets_m - y_m)
    for row, heading, off_m in zip(rows.tolist(), headings.tolist(), every_off_m, strict=True):
        for turn_deg in (0.0, *(TURNS_DEG if row == near_rows[0] else ())):
            turned = heading + np.deg2rad(turn_deg)
            scores = walls.scores(targets.chart(walls, row), middles, turned)
            if not turn_deg:
                own_score = max(own_score, float(scores[off_m < SLID_M / 2].max(initial=-np.inf)))
                scores = np.where(off_m >= SLID_M, scores, -np.inf)
            x, y = np.unravel_index(scores.argmax(), scores.shape)
            fits.append((float(scores[x, y]), row, offsets_m[x], offsets_m[y], turned))
    fits = sorted((fit for fit in fits if np.isfinite(fit[0])), key=lambda fit: -fit[0])
    if not fits or not np.isfinite(own_score):
        return Slide(0.0, ())
    lead = float(np.clip(own_score - fits[0][0], -WIDEST_LEAD, WIDEST_LEAD))
    places_m = np.array(
        [(targets.world_T_anchor[row] @ (x_m, y_m, 0.0, 1.0))[:2] for _, row, x_m, y_m, _ in fits]
    )
    return Slide(lead, tuple(_copy(*fits[i]) for i in _spaced(places_m)[:COPIES]))


def _copy(score: float, row: int, x_m: float, y_m: float, heading: float) -> Copy:
    at_m = np.array([[x_m, y_m, 0.0]])
    return Copy(score, row, pose(at_m, np.array([[0.0, 0.0, heading]]))[0])


def _spaced(xy_m: NDArray[np.float64]) -> list[int]:
    """The rows of positions (n, 2) that lie APART_M or more from each one kept before, in order."""
    near = np.linalg.norm(xy_m[:, None] - xy_m, axis=2) < APART_M
    kept: list[int] = []
    free = np.ones(len(xy_m), bool)
    for number in range(len(xy_m)):
        if free[number]:
            kept.append(number)
            free &= ~near[number]
    return kept
