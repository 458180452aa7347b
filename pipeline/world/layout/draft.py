"""A campus under construction: what it holds so far, and whether something more fits."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pipeline.world.layout.greenery import Plant
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Structure

BUILDING_SETBACK_M = 3.5


@dataclass(frozen=True)
class Pole:
    """A lamp post."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    dead_day: float = np.inf


@dataclass(frozen=True)
class Slot:
    """A parking slot."""

    x_m: float
    y_m: float
    yaw_rad: float
    dead_day: float = np.inf
    """The day on which a construction site closes it."""


@dataclass
class Draft:
    """The lists that the builders append to."""

    streets: Streets
    structures: list[Structure] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    poles: list[Pole] = field(default_factory=list)
    slots: list[Slot] = field(default_factory=list)
    taken_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) discs of x, y, radius that buildings cover."""

    def tuples(self) -> dict[str, Any]:
        """The lists as fields of a Campus."""
        return {name: tuple(getattr(self, name)) for name in ("structures", "plants", "poles", "slots")}

    def fits(self, structure: Structure) -> bool:
        """Whether a building keeps its distance from streets and from the other buildings."""
        outline_m = structure.outline_m()
        apart = (cdist(outline_m, self.taken_m[:, :2]) >= self.taken_m[:, 2]).all()
        return bool(apart and (self.streets.clearance_m(outline_m) > BUILDING_SETBACK_M).all())

    def build(self, structure: Structure) -> None:
        """Add a building, and reserve its ground."""
        self.structures.append(structure)
        self.taken_m = np.concatenate([self.taken_m, structure.discs_m()])

    def free(self, points_m: NDArray[np.float64], from_street_m: float, from_building_m: float) -> NDArray[np.bool_]:
        """Which (n,) of `points_m` (n, 2) keep these distances."""
        if not len(points_m):
            return np.zeros(0, bool)
        off_street = self.streets.clearance_m(points_m) > from_street_m
        return off_street & (cdist(points_m, self.taken_m[:, :2]) > self.taken_m[:, 2] + from_building_m).all(1)
