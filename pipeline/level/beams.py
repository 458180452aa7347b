"""Follows a query's beams through a level map: the shares that support and contradict a pose.

The score of the search depends on the ends of beams alone. Here each beam is followed from the
sensor to its end (METHODS 13.3). A beam is explained if it ends at a wall; it contradicts the map
if it ends in free space or passes through a wall.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import FARTHEST_M, Field, distance_at
from pipeline.level.sweeps import Gathered

EXPLAINED_M = 0.3
"""A beam is explained if it ends nearer to a wall than this."""
IN_FREE_M = 0.5
"""A beam contradicts the map if it ends in free space, farther than this from any wall."""
BEHIND_M = 0.3
"""A beam passes through a wall if it leaves the wall and gets farther than this from any wall. A
beam that grazes a wall does not."""
BEAMS = 600
"""Largest number of a query's beams that are followed."""


@dataclass(frozen=True)
class Support:
    """How a query's beams support a pose: three shares of the beams.

    All other beams end in unknown space, or beside a wall but not at it: they are no evidence.
    """

    explained: float
    """The share of beams that end at a wall."""
    in_free: float
    """The share of beams that end in known free space."""
    through: float
    """The share of beams that pass through a wall."""

    @property
    def contradicted(self) -> float:
        """The share of beams that contradict the map."""
        return self.in_free + self.through


def supports(field: Field, gathered: Gathered, poses: NDArray[np.float64]) -> list[Support]:
    """The support of each pose (k, 3): x, y in metres and heading in radians, in the grid."""
    count = len(gathered.ends_m)
    followed = np.linspace(0, max(count - 1, 0), min(BEAMS, count)).round().astype(int)
    shares = _shares(
        field.distance_m,
        field.walls,
        field.free,
        field.cell_m,
        gathered.starts_m[followed],
        gathered.ends_m[followed],
        poses,
    )
    return [Support(*map(float, row)) for row in shares]


@njit(cache=True, nogil=True)
def _shares(distance_m, walls, free, cell_m, starts_m, ends_m, poses):  # type: ignore[no-untyped-def]
    """The shares (k, 3) of beams for each pose; the columns are the fields of Support."""
    rows, cols = walls.shape
    counts = np.zeros((len(poses), 3))
    for number in range(len(poses)):
        x_m = poses[number, 0]
        y_m = poses[number, 1]
        cos = np.cos(poses[number, 2])
        sin = np.sin(poses[number, 2])
        for beam in range(len(ends_m)):
            start_x = (x_m + cos * starts_m[beam, 0] - sin * starts_m[beam, 1]) / cell_m
            start_y = (y_m + sin * starts_m[beam, 0] + cos * starts_m[beam, 1]) / cell_m
            end_x = (x_m + cos * ends_m[beam, 0] - sin * ends_m[beam, 1]) / cell_m
            end_y = (y_m + sin * ends_m[beam, 0] + cos * ends_m[beam, 1]) / cell_m
            if _passes_wall(distance_m, walls, start_x, start_y, end_x, end_y):
                counts[number, 2] += 1
                continue
            wall_m, _, _ = distance_at(distance_m, end_x, end_y, FARTHEST_M)
            is_on_map = 0 <= end_x < cols and 0 <= end_y < rows
            if wall_m < EXPLAINED_M:
                counts[number, 0] += 1
            elif wall_m > IN_FREE_M and is_on_map and free[int(end_y), int(end_x)]:
                counts[number, 1] += 1
    return counts / max(len(ends_m), 1)


@njit(cache=True, nogil=True, inline="always")
def _passes_wall(distance_m, walls, start_x, start_y, end_x, end_y):  # type: ignore[no-untyped-def]
    """Whether a beam passes through a wall; its start and end are in cells.

    The beam is followed in steps of a cell. Once it has met a wall, it must get farther than
    BEHIND_M from any wall.
    """
    rows, cols = walls.shape
    length = np.hypot(end_x - start_x, end_y - start_y)
    is_behind = False
    step = 0
    while step < length:
        share = step / length
        x = start_x + share * (end_x - start_x)
        y = start_y + share * (end_y - start_y)
        if 0 <= x < cols and 0 <= y < rows:
            if walls[int(y), int(x)]:
                is_behind = True
            elif is_behind and distance_m[int(y), int(x)] > BEHIND_M:
                return True
        step += 1
    return False
