"""A construction site: what is cleared for it, its fence, its mound."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.draft import Draft
from pipeline.world.layout.shapes import Kind
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Part, Structure

FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS, FENCE_AFTER_DAYS = 110, 70, 60
FENCE_MARGIN_M, FENCE_FROM_STREET_M = 4.0, 0.5
FENCE_HALF_THICKNESS_M, FENCE_HEIGHT_M = 0.1, 2.2
MOUND = (Part(0, 0, 8.0, 6.0, 0, 4.5),)


def clear_of_streets(streets: Streets, building: Structure) -> bool:
    """Whether the building's whole site, fence included, leaves the streets free."""
    return bool((streets.clearance_m(_site_m(building)) > FENCE_FROM_STREET_M).all())


def fence(building: Structure, day: float) -> Structure:
    """Four boards around the site, up before the building and gone some time after."""
    length_m, width_m = (half + FENCE_MARGIN_M for half in building.half_extent_m())
    boards = [(0, width_m, length_m, 0), (0, -width_m, length_m, 0), (length_m, 0, 0, width_m), (-length_m, 0, 0, width_m)]
    thick = FENCE_HALF_THICKNESS_M
    parts = tuple(Part(u, v, max(long, thick), max(wide, thick), 0, FENCE_HEIGHT_M) for u, v, long, wide in boards)
    born_day, dead_day = day - FENCE_BEFORE_DAYS, day + FENCE_AFTER_DAYS
    return replace(building, parts=parts, kind=Kind.WORKS, born_day=born_day, dead_day=dead_day)


def mound(building: Structure, day: float) -> Structure:
    """A heap of earth until the building stands in its place."""
    return replace(building, parts=MOUND, kind=Kind.WORKS, born_day=day - MOUND_BEFORE_DAYS, dead_day=day)


def clear(draft: Draft, building: Structure, day: float) -> None:
    """Everything small on the site goes on `day`, when the fence comes."""
    half_m = np.array(building.half_extent_m()) + FENCE_MARGIN_M
    c, s = np.cos(building.yaw_rad), np.sin(building.yaw_rad)

    def inside(thing: object) -> bool:
        offset_m = np.array([thing.x_m - building.x_m, thing.y_m - building.y_m])  # type: ignore[attr-defined]
        return bool((np.abs(offset_m @ np.array([[c, -s], [s, c]])) <= half_m).all())

    def until(dead_day: float) -> float:
        return min(dead_day, day)

    draft.plants = [replace(plant, dead_day=until(plant.dead_day)) if inside(plant) else plant for plant in draft.plants]
    draft.poles = [replace(pole, dead_day=until(pole.dead_day)) if inside(pole) else pole for pole in draft.poles]
    draft.slots = [replace(slot, dead_day=until(slot.dead_day)) if inside(slot) else slot for slot in draft.slots]
    small = {Kind.CLUTTER, Kind.LEAF}
    draft.structures = [
        replace(thing, dead_day=until(thing.dead_day)) if thing.kind in small and inside(thing) else thing
        for thing in draft.structures
    ]


def _site_m(building: Structure) -> NDArray[np.float64]:
    """Points (n, 2) no more than a metre apart all over the building's site, fence included."""
    half_m = np.array(building.half_extent_m()) + FENCE_MARGIN_M
    u, v = (np.linspace(-half, half, int(2 * half) + 2) for half in half_m)
    return building.to_world(np.stack(np.meshgrid(u, v), -1).reshape(-1, 2))
