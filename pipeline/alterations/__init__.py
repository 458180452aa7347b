"""Alterations: what is done to the points of a query before anything is drawn of them (SCI paper, section V; METHODS 2.8).

Every draw is made with `default_rng((alteration.seed, stamp_ns))`, anew for each query and each of its cases. So all methods are
asked with the same changes, and cases that draw the same numbers first share what these stand for: the larger wedge begins where
the smaller one does, the second wall comes to the first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

AS_DRIVEN = ""
"""The change of queries that are as they were driven."""
TURNED = "turned"


@dataclass(frozen=True)
class Case:
    """One of the ways in which an alteration meets every query; the first of each alteration leaves them as driven."""

    change: str = AS_DRIVEN
    """`turned`, `demolition`, `construction`; empty for a query as it was driven."""
    level: float = 0.0
    """Degrees of a wedge, or number of walls."""
    shadow: bool = False
    """What lies behind a new wall is hidden by it."""
    repeat: int = 0
    """Of drawings that differ by chance alone."""


def read_cases(attrs: Mapping[str, Any]) -> list[Case]:
    """The cases that the rows of an artifact of views, rankings or evaluations belong to, from its attributes."""
    return [Case(**case) for case in attrs["cases"]]


class Alteration(Protocol):
    """One file in conf/alteration; its fields are the keys of its yaml."""

    @property
    def seed(self) -> int:
        """Of every draw, with the stamp of the query's anchor."""

    @property
    def cases(self) -> Sequence[Case]:
        """What it makes of each query, one after the other; the first is as driven."""

    def alter(self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator) -> tuple[NDArray[np.floating], float]:
        """Points (m, 3) of one query of (n, 3), z up from the ground around the sensor, and by how many radians the robot is
        turned to the left; a turned robot's points are given in its own frame. A case as driven returns the points themselves,
        a turned one no others than these."""
