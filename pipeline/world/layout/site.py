"""A construction site: its fence, its mound, and the clearing of its ground."""

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.world import Floats
from pipeline.world.layout.campus import Campus
from pipeline.world.layout.shapes import Kind
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Part, Structure

FENCE_BEFORE_DAYS = 110
MOUND_BEFORE_DAYS = 70
FENCE_AFTER_DAYS = 60
FENCE_MARGIN_M = 4.0
FENCE_FROM_STREET_M = 0.5
FENCE_HALF_THICKNESS_M = 0.1
FENCE_HEIGHT_M = 2.2
MOUND = (Part(0, 0, 8.0, 6.0, 0, 4.5),)


def clear_of_streets(streets: Streets, building: Structure) -> bool:
    """Whether the whole site of the building, fence included, leaves the streets free: points at
    most a metre apart do."""
    u, v = (np.linspace(-half, half, int(2 * half) + 2) for half in _half_m(building))
    places_m = building.to_world(np.stack(np.meshgrid(u, v), -1).reshape(-1, 2))
    return bool((streets.clearance_m(places_m) > FENCE_FROM_STREET_M).all())


def fence(building: Structure, day: float) -> Structure:
    """Four boards around the site, from before the building until some time after."""
    (length_m, width_m) = _half_m(building)
    thick = FENCE_HALF_THICKNESS_M
    boards = [
        (0, width_m, length_m, 0),
        (0, -width_m, length_m, 0),
        (length_m, 0, 0, width_m),
        (-length_m, 0, 0, width_m),
    ]
    parts = tuple(
        Part(u, v, max(long, thick), max(wide, thick), 0, FENCE_HEIGHT_M)
        for u, v, long, wide in boards
    )
    born_day = day - FENCE_BEFORE_DAYS
    dead_day = day + FENCE_AFTER_DAYS
    return replace(building, parts=parts, kind=Kind.WORKS, born_day=born_day, dead_day=dead_day)


def mound(building: Structure, day: float) -> Structure:
    """A heap of earth in the place of the building until it stands."""
    return replace(
        building, parts=MOUND, kind=Kind.WORKS, born_day=day - MOUND_BEFORE_DAYS, dead_day=day
    )


def clear_site(campus: Campus, building: Structure, day: float) -> None:
    """Remove all small things on the site from `day` on, when the fence is built."""
    half_m = _half_m(building)
    c = np.cos(building.yaw_rad)
    s = np.sin(building.yaw_rad)

    def cleared(thing: Any) -> Any:
        offset_m = np.array([thing.x_m - building.x_m, thing.y_m - building.y_m])
        inside = (np.abs(offset_m @ np.array([[c, -s], [s, c]])) <= half_m).all()
        return replace(thing, dead_day=min(thing.dead_day, day)) if inside else thing

    small = {Kind.BORDER, Kind.CLUTTER, Kind.LEAF}
    campus.plants, campus.poles, campus.slots, campus.spots = (
        list(map(cleared, things))
        for things in (campus.plants, campus.poles, campus.slots, campus.spots)
    )
    campus.structures = [
        cleared(thing) if thing.kind in small else thing for thing in campus.structures
    ]


def _half_m(building: Structure) -> Floats:
    """Half the length and half the width (2,) of its site, fence included."""
    return building.half_extent_m() + FENCE_MARGIN_M
