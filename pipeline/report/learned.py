"""How a model was trained, as its file keeps it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline import store


@dataclass(frozen=True)
class Learned:
    """How a model was trained, as it keeps it."""

    recipe: Mapping[str, str]
    """The parameters that it was trained with."""
    curves: Mapping[str, NDArray[np.float64]]
    """Name to values (round,), a round lying between two looks at held-out blocks; none for a method that learns nothing."""
    best_round: int | None
    """The one that was kept, 0-based; None where the model does not say."""
    megabytes: float

    @property
    def rounds(self) -> int:
        """How many there were."""
        return max(map(len, self.curves.values()), default=0)

    @classmethod
    def read(cls, path: Path) -> Self:
        """From the file of a model."""
        model = store.read_model(path)
        curves = {name.removeprefix("curves/"): model[name] for name in sorted(model) if name.startswith("curves/")}
        kept = int(model["best_epoch"]) if "best_epoch" in model else None
        return cls(store.read_recipe(path), curves, kept, sum(array.nbytes for array in model.values()) / 1e6)
