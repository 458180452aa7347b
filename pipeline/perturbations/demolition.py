"""Demolition: removes a query's points in a wedge (SCI paper, Fig. 9; METHODS 2.8)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Seed, checked
from pipeline.perturbations import UNCHANGED, Case

DEMOLITION = "demolition"
"""`Case.change` of queries without the points in a wedge."""


@dataclass(frozen=True)
@checked("perturbation")
class Demolition:
    """Removes all points whose azimuth lies in a wedge, including those of the ground."""

    widths_deg: Sequence[float] = (30, 60, 90)
    """Widths of the wedge, one case each. All wedges of a query begin at the same random azimuth
    and open to the left."""
    seed: Seed = 0
    """See `pipeline.perturbations.generator`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "widths_deg", tuple(self.widths_deg))
        if not self.widths_deg or not all(0 < width < 360 for width in self.widths_deg):
            raise ConfigError(
                f"perturbation.widths_deg={list(self.widths_deg)}: expected angles between 0 and "
                "360"
            )

    @property
    def cases(self) -> Sequence[Case]:
        """The unperturbed case, then a case for each width."""
        return (Case(), *(Case(DEMOLITION, float(width)) for width in self.widths_deg))

    def perturb(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Remove the points in a wedge of `case.level` degrees; the robot does not turn.

        The wedge begins at a random azimuth, uniform in [0, 2π).
        """
        if case.change == UNCHANGED:
            return points_m, 0.0
        half_rad = math.radians(case.level) / 2
        middle_rad = rng.uniform(0, 2 * math.pi) + half_rad
        x, y = points_m.T[:2]
        # A point is in the wedge if its angle to the middle is less than half the width.
        along_middle_m = math.cos(middle_rad) * x + math.sin(middle_rad) * y
        is_outside = along_middle_m <= math.cos(half_rad) * np.sqrt(x * x + y * y)
        return points_m[is_outside], 0.0
