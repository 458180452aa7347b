"""The campus: everything that does not move, and whether something more fits.

Things have the days on which they appear and vanish.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from pipeline.world import Floats
from pipeline.world.layout.buildings import Template
from pipeline.world.layout.greenery import Plant, crowns, trunks
from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import CYLINDER, Kind, Records, columns, records, standing
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Structure, boxes

POLE_REFLECTANCE = 0.3
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
class Campus:
    """The streets, the ground, and everything that stands on it.

    Structures, plants and poles have the days on which they stand, slots and spots the day on which
    they close.
    """

    streets: Streets
    ground: Ground
    recipes: list[Template]
    structures: list[Structure] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    poles: list[Pole] = field(default_factory=list)
    slots: list[Slot] = field(default_factory=list)
    fronts: dict[Template, Template] = field(default_factory=dict)
    """Parts at the walls of a template that need no room of their own: they stand wherever it
    does."""
    spots: list[Slot] = field(default_factory=list)
    """Where clutter stands on some days."""
    taken_m: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) discs of x, y, radius that buildings cover."""

    def fits(self, structure: Structure, setback_m: float = BUILDING_SETBACK_M) -> bool:
        """Whether a building keeps its distance from streets and from the other buildings."""
        outline_m = structure.outline_m()
        is_clear = (cdist(outline_m, self.taken_m[:, :2]) >= self.taken_m[:, 2]).all()
        return bool(is_clear and (self.streets.clearance_m(outline_m) > setback_m).all())

    def build(self, structure: Structure) -> None:
        """Add a building, and reserve its ground."""
        self.structures.append(structure)
        self.taken_m = np.concatenate([self.taken_m, structure.discs_m()])

    def free(
        self, points_m: Floats, from_street_m: float, from_building_m: float
    ) -> NDArray[np.bool_]:
        """Which (n,) of `points_m` (n, 2) keep these distances."""
        off_street = self.streets.clearance_m(points_m) > from_street_m
        return off_street & (
            cdist(points_m, self.taken_m[:, :2]) > self.taken_m[:, 2] + from_building_m
        ).all(1)


def shapes_on(campus: Campus, day: int) -> tuple[Records, Records, Records]:
    """Boxes, cylinders and crowns of everything that stands on `day`.

    The extinction of porous ones is still 0.
    """
    plants = campus.plants
    ground = campus.ground
    cylinders = np.concatenate(
        [standing(trunks(plants, ground), day), standing(_poles(campus), day)]
    )
    return (
        standing(boxes([_fronted(campus, thing) for thing in campus.structures], ground), day),
        cylinders,
        standing(crowns(plants, ground), day),
    )


def _fronted(campus: Campus, thing: Structure) -> Structure:
    front = campus.fronts.get(thing.parts)
    return replace(thing, parts=thing.parts + front) if front else thing


def _poles(campus: Campus) -> Records:
    table = columns(campus.poles, "x_m", "y_m", "radius_m", "height_m", "dead_day")
    base_m = campus.ground.at(table["x_m"], table["y_m"])
    height_m = table.pop("height_m")
    return records(
        CYLINDER,
        bottom_m=base_m - 1,
        top_m=base_m + height_m,
        reflectance=POLE_REFLECTANCE,
        kind=Kind.POLE,
        **table,
    )
