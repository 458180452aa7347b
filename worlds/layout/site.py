"""A construction site: its fence, its mound of earth, and the clearing of its ground.

A fence is put up first, then a mound is heaped, then the building replaces it, and at last the
fence is removed.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from worlds import Floats
from worlds.layout.campus import Campus
from worlds.layout.shapes import Kind
from worlds.layout.streets import Streets
from worlds.layout.structures import Part, Structure

FENCE_BEFORE_DAYS = 110
"""How long before the building the fence is put up."""
MOUND_BEFORE_DAYS = 70
"""How long before the building the mound is heaped."""
FENCE_AFTER_DAYS = 60
"""How long after the building stands the fence is removed."""
FENCE_MARGIN_M = 4.0
"""Distance between the building and the fence."""
FENCE_FROM_STREET_M = 0.5
"""Least distance between the site and the border of a street."""
FENCE_HALF_THICKNESS_M = 0.1
FENCE_HEIGHT_M = 2.2
MOUND = (Part(0, 0, 8.0, 6.0, 0, 4.5),)


def clear_of_streets(streets: Streets, building: Structure) -> bool:
    """Whether the site of the building, including its fence, leaves the streets free.

    It is tested at points at most a metre apart.
    """
    half_length_m, half_width_m = _half_m(building)
    ahead_m = np.linspace(-half_length_m, half_length_m, int(2 * half_length_m) + 2)
    left_m = np.linspace(-half_width_m, half_width_m, int(2 * half_width_m) + 2)
    places_m = building.to_world(np.stack(np.meshgrid(ahead_m, left_m), -1).reshape(-1, 2))
    return bool((streets.clearance_m(places_m) > FENCE_FROM_STREET_M).all())


def fence(building: Structure, day: float) -> Structure:
    """The fence of a building that stands from `day` on: four boards around the site."""
    half_length_m, half_width_m = _half_m(building)
    thickness_m = FENCE_HALF_THICKNESS_M
    parts = (
        Part(0, half_width_m, half_length_m, thickness_m, 0, FENCE_HEIGHT_M),
        Part(0, -half_width_m, half_length_m, thickness_m, 0, FENCE_HEIGHT_M),
        Part(half_length_m, 0, thickness_m, half_width_m, 0, FENCE_HEIGHT_M),
        Part(-half_length_m, 0, thickness_m, half_width_m, 0, FENCE_HEIGHT_M),
    )
    born_day = day - FENCE_BEFORE_DAYS
    dead_day = day + FENCE_AFTER_DAYS
    return replace(building, parts=parts, kind=Kind.WORKS, born_day=born_day, dead_day=dead_day)


def mound(building: Structure, day: float) -> Structure:
    """A heap of earth in the place of a building until `day`, from which on it stands."""
    return replace(
        building, parts=MOUND, kind=Kind.WORKS, born_day=day - MOUND_BEFORE_DAYS, dead_day=day
    )


def clear_site(campus: Campus, building: Structure, day: float) -> None:
    """Remove all small things on a building's site from `day` on, when its fence is built."""
    half_m = _half_m(building)
    c = np.cos(building.yaw_rad)
    s = np.sin(building.yaw_rad)

    def cleared(thing: Any) -> Any:
        """The thing, which stands no longer than to `day` if it is on the site."""
        offset_m = np.array([thing.x_m - building.x_m, thing.y_m - building.y_m])
        is_inside = (np.abs(offset_m @ np.array([[c, -s], [s, c]])) <= half_m).all()
        return replace(thing, dead_day=min(thing.dead_day, day)) if is_inside else thing

    campus.plants = [cleared(plant) for plant in campus.plants]
    campus.poles = [cleared(pole) for pole in campus.poles]
    campus.slots = [cleared(slot) for slot in campus.slots]
    campus.spots = [cleared(spot) for spot in campus.spots]
    small_kinds = {Kind.BORDER, Kind.CLUTTER, Kind.LEAF}
    campus.structures = [
        cleared(structure) if structure.kind in small_kinds else structure
        for structure in campus.structures
    ]


def _half_m(building: Structure) -> Floats:
    """Half the length and half the width (2,) of a building's site, up to its fence."""
    return building.half_extent_m() + FENCE_MARGIN_M
