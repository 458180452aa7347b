"""The robot turned on the spot by random angles, before its view is computed (METHODS 2.8).

SCI paper, Fig. 10.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import AS_DRIVEN, TURNED, Case
from pipeline.core.settings import Count, Seed, check


@dataclass(frozen=True)
class Turned:
    """Turns the robot: its points are rotated, and the view is drawn anew from them."""

    repeats: Count = 5
    """Angles of each query."""
    seed: Seed = 0
    """Of the random angles (pipeline.alterations.generator)."""

    def __post_init__(self) -> None:
        check(self, "alteration")

    @property
    def cases(self) -> Sequence[Case]:
        """As driven, then each repeat."""
        return (Case(), *(Case(TURNED, repeat=repeat) for repeat in range(self.repeats)))

    def alter(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """The points (n, 3) as a robot turned to the left by U[0, 2π) sees them, and that angle.

        The angle is in radians.
        """
        if case.change == AS_DRIVEN:
            return points_m, 0.0
        # each repeat takes a further number of the generator, which is the same for all repeats
        left_rad = float(rng.uniform(0, 2 * math.pi, case.repeat + 1)[-1])
        return turned(points_m, left_rad), left_rad


def turned(points_m: NDArray[np.floating], left_rad: float) -> NDArray[np.floating]:
    """Points (n, 3) in the frame of a robot that has turned to the left by so much: Rz(−left) p."""
    c = math.cos(left_rad)
    s = math.sin(left_rad)
    seen = points_m.copy()
    x, y = points_m.T[:2]
    seen[:, 0] = c * x + s * y
    seen[:, 1] = c * y - s * x
    return seen
