"""No alteration: sequences whose own drive is the test, such as one in the opposite direction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.running.settings import check


@dataclass(frozen=True)
class AsDriven:
    """Leaves every query as it is."""

    seed: int = 0
    """Nothing is drawn."""

    def __post_init__(self) -> None:
        check(self, "alteration")

    @property
    def cases(self) -> Sequence[Case]:
        """As driven alone."""
        return (Case(),)

    def alter(self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator) -> tuple[NDArray[np.floating], float]:
        """The points themselves, and no turn."""
        return points_m, 0.0
