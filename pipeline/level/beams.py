"""What a level map says for and against a pose: beams explained, beams contradicted."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import FARTHEST_M, Field, distance_at
from pipeline.level.sweeps import Gathered

EXPLAINED_M = 0.3
"""A beam is explained by a wall this near its end."""
IN_FREE_M = 0.5
"""A hit in known free space and this far from any wall contradicts the map."""
BEHIND_M = 0.3
"""A beam that comes so far out behind a wall contradicts it; one that grazes it does not."""
BEAMS = 600
"""Of a query so many beams are looked at."""


@dataclass(frozen=True)
class Support:
    """Shares of a query's beams; what lacks of 1 ends in unknown space or just beside a wall."""

    explained: float
    """They end at a wall."""
    in_free: float
    """They end in known free space."""
    through: float
    """They pass through a wall."""

    @property
    def contradicted(self) -> float:
        """Of the beams, the share that the map contradicts."""
        return self.in_free + self.through


def supports(field: Field, gathered: Gathered, poses: NDArray[np.float64]) -> list[Support]:
    """The support of each of the poses (k, 3) in the field's grid."""
    count = len(gathered.ends_m)
    chosen = np.linspace(0, max(count - 1, 0), min(BEAMS, count)).round().astype(int)
    shares = _shares(
        field.distance_m,
        field.walls,
        field.free,
        field.cell_m,
        gathered.starts_m[chosen],
        gathered.ends_m[chosen],
        poses,
    )
    return [Support(*map(float, row)) for row in shares]


@njit(cache=True, nogil=True)
def _shares(distance_m, walls, free, cell_m, starts_m, ends_m, poses):  # type: ignore[no-untyped-def]
    """Shares (k, 3) of beams that are explained, end in free space, pass a wall."""
    rows, cols = walls.shape
    shares = np.zeros((len(poses), 3))
    for number in range(len(poses)):
        cos = np.cos(poses[number, 2])
        sin = np.sin(poses[number, 2])
        for beam in range(len(ends_m)):
            start_x = (
                poses[number, 0] + cos * starts_m[beam, 0] - sin * starts_m[beam, 1]
            ) / cell_m
            start_y = (
                poses[number, 1] + sin * starts_m[beam, 0] + cos * starts_m[beam, 1]
            ) / cell_m
            end_x = (poses[number, 0] + cos * ends_m[beam, 0] - sin * ends_m[beam, 1]) / cell_m
            end_y = (poses[number, 1] + sin * ends_m[beam, 0] + cos * ends_m[beam, 1]) / cell_m
            if _passes_wall(distance_m, walls, start_x, start_y, end_x, end_y):
                shares[number, 2] += 1
                continue
            distance = distance_at(distance_m, end_x, end_y, FARTHEST_M)[0]
            if distance < EXPLAINED_M:
                shares[number, 0] += 1
            elif (
                distance > IN_FREE_M
                and 0 <= end_x < cols
                and 0 <= end_y < rows
                and free[int(end_y), int(end_x)]
            ):
                shares[number, 1] += 1
    return shares / max(len(ends_m), 1)


@njit(cache=True, nogil=True, inline="always")
def _passes_wall(distance_m, walls, start_x, start_y, end_x, end_y):  # type: ignore[no-untyped-def]
    """Whether a beam goes through a wall and comes out more than BEHIND_M behind it."""
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
