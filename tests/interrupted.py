"""For tests of training: compares models, and interrupts a training."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.core.progress import Progress


def same(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> bool:
    """Whether two models have the same arrays, byte for byte."""
    return one.keys() == other.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one
    )


@dataclass(frozen=True)
class PowerCut(Progress):
    """Stops a training when this epoch or round, counted from 1, is about to be shown."""

    at: int = 2

    def note(self, **numbers: float) -> None:
        if numbers["epoch"] == self.at:
            raise KeyboardInterrupt
