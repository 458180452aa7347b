"""Several alterations that share the case as driven."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Alteration, Case
from pipeline.core.errors import ConfigError
from pipeline.core.settings import check


@dataclass(frozen=True)
class Several:
    """The cases of several alterations, one after the other.

    Each case is that of its part alone.
    """

    parts: Sequence[Alteration]
    """All of one seed, and no two with a case in common but the first."""

    def __post_init__(self) -> None:
        check(self, "alteration")
        object.__setattr__(self, "parts", tuple(self.parts))
        if strange := [part for part in self.parts if not hasattr(part, "cases")]:
            raise ConfigError(
                f"alteration.parts: expected alterations, each with its _target_, got {strange}"
            )
        if len({part.seed for part in self.parts}) != 1:
            raise ConfigError(
                "alteration.parts: expected parts of one seed, got "
                f"{[part.seed for part in self.parts]}"
            )
        if len(set(self.cases)) < len(self.cases):
            raise ConfigError(
                "alteration.parts: two parts have a case in common; leave one of them out"
            )

    @property
    def seed(self) -> int:
        """The seed that all parts share."""
        return self.parts[0].seed

    @property
    def cases(self) -> Sequence[Case]:
        """As driven, then the cases of each part."""
        return (Case(), *(case for part in self.parts for case in part.cases if case != Case()))

    def alter(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Alter the points as the part does that has this case."""
        (part, *_) = (part for part in self.parts if case in part.cases)
        return part.alter(case, points_m, rng)
