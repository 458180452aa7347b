"""Demolition: no points in a wedge of directions (SCI paper, Fig. 9; METHODS 2.8)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import AS_DRIVEN, Case
from pipeline.core.errors import ConfigError
from pipeline.core.settings import Seed, check

DEMOLITION = "demolition"


@dataclass(frozen=True)
class Demolition:
    """Removes all points, ground included, whose azimuth lies in a wedge."""

    widths_deg: Sequence[float] = (30, 60, 90)
    """Widths of the wedge, a case each.

    All wedges of a query begin at one random azimuth and open to the left.
    """
    seed: Seed = 0
    """See pipeline.alterations."""

    def __post_init__(self) -> None:
        check(self, "alteration")
        object.__setattr__(self, "widths_deg", tuple(self.widths_deg))
        if not self.widths_deg or not all(0 < width < 360 for width in self.widths_deg):
            raise ConfigError(
                f"alteration.widths_deg={list(self.widths_deg)}: expected angles between 0 and 360"
            )

    @property
    def cases(self) -> Sequence[Case]:
        """As driven, then each width."""
        return (Case(), *(Case(DEMOLITION, float(width)) for width in self.widths_deg))

    def alter(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """The points (m, 3) outside a wedge of `case.level` degrees, and no turn.

        The wedge begins at an azimuth U[0, 2π).
        """
        if case.change == AS_DRIVEN:
            return points_m, 0.0
        half_rad = math.radians(case.level) / 2
        middle_rad = rng.uniform(0, 2 * math.pi) + half_rad
        x, y = points_m.T[:2]
        along_m = math.cos(middle_rad) * x + math.sin(middle_rad) * y
        return points_m[along_m <= math.cos(half_rad) * np.sqrt(x * x + y * y)], 0.0
