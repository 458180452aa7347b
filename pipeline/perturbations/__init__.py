"""Perturbations: changes to the points of a query before its view is computed (SCI paper, section
V; METHODS 2.8).

A perturbation turns the robot, removes points or adds walls. It has several cases, such as wedges
of 30, 60 and 90°, each of which is applied to every query; the first case is unperturbed.

The random numbers of a query depend only on the perturbation's seed and the query's stamp
(`generator`). So all methods get the same changes, and the cases of a query agree in the numbers
that they draw first: a wide wedge begins where the narrow wedge begins, and the first of two walls
is the wall of the case with one wall.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

UNCHANGED = ""
"""`Case.change` of unperturbed queries."""
TURNED = "turned"
"""`Case.change` of queries whose robot is turned on the spot."""


@dataclass(frozen=True)
class Case:
    """One change of a perturbation, which is applied to every query."""

    change: str = UNCHANGED
    """`turned`, `demolition` or `construction`; empty for unperturbed queries."""
    level: float = 0.0
    """Width of the wedge in degrees, or number of walls."""
    shadow: bool = False
    """Whether points behind a new wall are removed."""
    repeat: int = 0
    """The number of the repeat, for random changes that are repeated."""


def read_cases(cases: Iterable[Mapping[str, Any]]) -> list[Case]:
    """Read the cases of an artifact of views, rankings or evaluations from its attribute `cases`.

    The artifact has the rows of the first case, then the rows of the second case, and so on.
    """
    return [Case(**case) for case in cases]


class Perturbation(Protocol):
    """The interface of a perturbation; its fields are the keys of its yaml in conf/perturbation."""

    @property
    def seed(self) -> int:
        """The seed of the random numbers, together with the stamp of a query's anchor."""

    @property
    def cases(self) -> Sequence[Case]:
        """The cases; the first is unperturbed."""

    def perturb(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Perturb the points (n, 3) of one query, z up from the ground around the sensor.

        Returns the perturbed points (m, 3) in the frame of the turned robot, and the turn to the
        left in radians. The unperturbed case returns the points themselves, a turned case returns
        the rotated points.
        """


def generator(perturbation: Perturbation, stamp_ns: int) -> np.random.Generator:
    """A fresh generator of random numbers for one query, given the stamp of its anchor."""
    return np.random.default_rng((perturbation.seed, int(stamp_ns)))
