"""The campus: the streets, the ground, and everything that stands on it and does not move.

Each thing has the days on which it appears and vanishes; `shapes_on` gives what stands on one day
as shapes for the ray caster. The campus also knows where the ground is taken, and so whether
something more fits.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from worlds import Floats
from worlds.layout.buildings import Template
from worlds.layout.greenery import Plant, crowns, trunks
from worlds.layout.ground import Ground
from worlds.layout.shapes import CYLINDER, Kind, Records, columns, records, standing
from worlds.layout.streets import Streets
from worlds.layout.structures import Structure, boxes

POLE_REFLECTANCE = 0.3
BUILDING_SETBACK_M = 3.5
"""Least distance between a building and the border of a street."""


@dataclass(frozen=True)
class Pole:
    """A lamp post."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    dead_day: float = np.inf
    """The day on which a construction site removes it."""


@dataclass(frozen=True)
class Slot:
    """A place for something that stands there on some days: a parked car, or clutter."""

    x_m: float
    y_m: float
    yaw_rad: float
    dead_day: float = np.inf
    """The day on which a construction site closes it."""


@dataclass
class Campus:
    """The streets, the ground, and everything that stands on it."""

    streets: Streets
    ground: Ground
    templates: list[Template]
    """The templates of its large buildings."""
    structures: list[Structure] = field(default_factory=list)
    plants: list[Plant] = field(default_factory=list)
    poles: list[Pole] = field(default_factory=list)
    slots: list[Slot] = field(default_factory=list)
    """Where cars park on some days."""
    fronts: dict[Template, Template] = field(default_factory=dict)
    """For each template, the parts in front of its walls, such as porches. They stand wherever a
    building of the template does, and need no room of their own."""
    spots: list[Slot] = field(default_factory=list)
    """Where clutter, such as bins, stands on some days."""
    taken_m: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) x, y and radius of the discs that buildings cover."""

    def fits(self, structure: Structure, setback_m: float = BUILDING_SETBACK_M) -> bool:
        """Whether a building keeps its distance from the streets and from all other buildings."""
        footprint_m = structure.footprint_m()
        is_clear = (cdist(footprint_m, self.taken_m[:, :2]) >= self.taken_m[:, 2]).all()
        return bool(is_clear and (self.streets.clearance_m(footprint_m) > setback_m).all())

    def build(self, structure: Structure) -> None:
        """Add a building, and take its ground."""
        self.structures.append(structure)
        self.taken_m = np.concatenate([self.taken_m, structure.discs_m()])

    def is_free(
        self, points_m: Floats, from_street_m: float, from_building_m: float
    ) -> NDArray[np.bool_]:
        """True (n,) for points (n, 2) at least this far from all streets and buildings."""
        is_off_streets = self.streets.clearance_m(points_m) > from_street_m
        disc_distances_m = cdist(points_m, self.taken_m[:, :2])
        is_off_buildings = (disc_distances_m > self.taken_m[:, 2] + from_building_m).all(1)
        return is_off_streets & is_off_buildings


def shapes_on(campus: Campus, day: int) -> tuple[Records, Records, Records]:
    """The boxes, cylinders and crowns of everything that stands on `day`.

    The extinction of porous shapes, which depends on the season, is not set yet.
    """
    plants = campus.plants
    ground = campus.ground
    structures = [_with_front(campus, structure) for structure in campus.structures]
    cylinders = [standing(trunks(plants, ground), day), standing(_poles(campus), day)]
    return (
        standing(boxes(structures, ground), day),
        np.concatenate(cylinders),
        standing(crowns(plants, ground), day),
    )


def _with_front(campus: Campus, structure: Structure) -> Structure:
    """A structure with the parts in front of its walls, if its template has any."""
    front = campus.fronts.get(structure.parts)
    return replace(structure, parts=structure.parts + front) if front else structure


def _poles(campus: Campus) -> Records:
    """The cylinders of the lamp posts."""
    table = columns(campus.poles, "x_m", "y_m", "radius_m", "height_m", "dead_day")
    base_m = campus.ground.at(table["x_m"], table["y_m"])
    height_m = table.pop("height_m")
    return records(
        CYLINDER,
        bottom_m=base_m - 1,  # into the ground, so that there is no gap on slopes
        top_m=base_m + height_m,
        reflectance=POLE_REFLECTANCE,
        kind=Kind.POLE,
        **table,
    )
