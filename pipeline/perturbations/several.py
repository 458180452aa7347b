"""Joins several perturbations into one, such as turned, demolition and construction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import checked
from pipeline.perturbations import Case, Perturbation


@dataclass(frozen=True)
@checked("perturbation")
class Several:
    """The cases of several perturbations, one after the other.

    A query is perturbed by one part at a time; they are not combined.
    """

    parts: Sequence[Perturbation]
    """The perturbations; they must have the same seed, and only the unperturbed case in common."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        not_perturbations = [part for part in self.parts if not hasattr(part, "cases")]
        if not_perturbations:
            raise ConfigError(
                "perturbation.parts: expected perturbations, each with its _target_, got "
                f"{not_perturbations}"
            )
        if len({part.seed for part in self.parts}) != 1:
            raise ConfigError(
                "perturbation.parts: expected parts of one seed, got "
                f"{[part.seed for part in self.parts]}"
            )
        if len(set(self.cases)) < len(self.cases):
            raise ConfigError(
                "perturbation.parts: two parts have a case in common; leave one of them out"
            )

    @property
    def seed(self) -> int:
        """The seed that all parts share."""
        return self.parts[0].seed

    @property
    def cases(self) -> Sequence[Case]:
        """The unperturbed case, then the other cases of each part."""
        cases = [Case()]
        for part in self.parts:
            cases += [case for case in part.cases if case != Case()]
        return tuple(cases)

    def perturb(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Perturb the points like the part that has this case."""
        part = next(part for part in self.parts if case in part.cases)
        return part.perturb(case, points_m, rng)
