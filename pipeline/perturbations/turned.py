"""Turned: turns the robot on the spot by random angles before its view is computed (SCI paper,
Fig. 10; METHODS 2.8).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.settings import Count, Seed, checked
from pipeline.perturbations import TURNED, UNCHANGED, Case


@dataclass(frozen=True)
@checked("perturbation")
class Turned:
    """Turns the robot: its points are rotated, not the columns of its view."""

    repeats: Count = 5
    """Number of random angles for each query, one case each."""
    seed: Seed = 0
    """See `pipeline.perturbations.generator`."""

    @property
    def cases(self) -> Sequence[Case]:
        """The unperturbed case, then a case for each repeat."""
        return (Case(), *(Case(TURNED, repeat=repeat) for repeat in range(self.repeats)))

    def perturb(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Turn the robot to the left by a random angle, uniform in [0, 2π).

        Returns the points (n, 3) in the frame of the turned robot, and the angle in radians.
        """
        if case.change == UNCHANGED:
            return points_m, 0.0
        # All repeats have the same generator; repeat i takes its number i.
        left_rad = float(rng.uniform(0, 2 * math.pi, case.repeat + 1)[-1])
        return turned(points_m, left_rad), left_rad


def turned(points_m: NDArray[np.floating], left_rad: float) -> NDArray[np.floating]:
    """Points (n, 3) in the frame of a robot turned to the left by `left_rad`: Rz(−left) p."""
    c = math.cos(left_rad)
    s = math.sin(left_rad)
    rotated = points_m.copy()
    x, y = points_m.T[:2]
    rotated[:, 0] = c * x + s * y
    rotated[:, 1] = c * y - s * x
    return rotated
