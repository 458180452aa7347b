"""Alterations: changes to the points of a query before its view is computed.

SCI paper, section V; METHODS 2.8. Each query and each of its cases gets a fresh
`default_rng((alteration.seed, stamp_ns))`. So all methods get the same changes, and cases that use
the same random numbers first agree in them: a wider wedge begins where the narrower one does, and
two walls are the one wall and another.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

AS_DRIVEN = ""
"""The change of queries that are as they were driven."""
TURNED = "turned"


@dataclass(frozen=True)
class Case:
    """One change of an alteration, made to every query.

    Each alteration's first case changes nothing.
    """

    change: str = AS_DRIVEN
    """`turned`, `demolition`, `construction`; empty for a query as it was driven."""
    level: float = 0.0
    """Degrees of a wedge, or number of walls."""
    shadow: bool = False
    """Points behind a new wall are removed."""
    repeat: int = 0
    """Number of the random repeat."""


def read_cases(cases: Iterable[Mapping[str, Any]]) -> list[Case]:
    """The cases of an artifact of views, rankings or evaluations, from its attribute `cases`.

    Its rows belong to one case after the other.
    """
    return [Case(**case) for case in cases]


class Alteration(Protocol):
    """One file in conf/alteration; its fields are the keys of its yaml."""

    @property
    def seed(self) -> int:
        """Seeds the random numbers, together with the stamp of the query's anchor."""

    @property
    def cases(self) -> Sequence[Case]:
        """The cases of each query; the first is as driven."""

    def alter(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Alter the points (n, 3) of one query, z up from the ground around the sensor.

        Returns points (m, 3), and by how many radians the robot is turned to the left; a turned
        robot's points are given in its own frame. A case as driven returns the points themselves, a
        turned one no others than these.
        """


def generator(alteration: Alteration, stamp_ns: int) -> np.random.Generator:
    """The random numbers of one query and case, given the stamp of the query's anchor."""
    return np.random.default_rng((alteration.seed, int(stamp_ns)))
