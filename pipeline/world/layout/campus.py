"""The campus: everything that does not move, with the days on which it appears and vanishes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.blocks import divide, fill
from pipeline.world.layout.buildings import Template, templates
from pipeline.world.layout.draft import Draft, Pole, Slot
from pipeline.world.layout.furniture import furnish_streets
from pipeline.world.layout.greenery import Plant, crowns, trunks
from pipeline.world.layout.ground import Ground, rolling_ground
from pipeline.world.layout.shapes import CYLINDER, Kind, Records, records, standing
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Structure, boxes
from pipeline.world.seeds import Stream, generator

POLE_REFLECTANCE = 0.3


@dataclass(frozen=True)
class Campus:
    """Structures, plants and poles have the days on which they stand, slots the day on which they close."""

    streets: Streets
    ground: Ground
    recipes: tuple[Template, ...]
    structures: tuple[Structure, ...]
    plants: tuple[Plant, ...]
    poles: tuple[Pole, ...]
    slots: tuple[Slot, ...]
    taken_m: NDArray[np.float64]
    """(n, 3) discs of x, y, radius that buildings cover."""

    def draft(self) -> Draft:
        """A draft that starts as this campus."""
        return Draft(self.streets, list(self.structures), list(self.plants), list(self.poles), list(self.slots), self.taken_m)


def build_campus(seed: int, blocks: int, streets: Streets) -> Campus:
    """The campus around `streets`, as it stands on the training day."""
    ground = rolling_ground(generator(seed, Stream.GROUND), streets.nodes_m.min(0), streets.nodes_m.max(0))
    rng = generator(seed, Stream.BLOCKS)
    recipes = templates(rng)
    draft = Draft(streets)
    for block in divide(rng, streets, blocks):
        fill(rng, block, draft, recipes)
    furnish_streets(generator(seed, Stream.FURNITURE), draft)
    return Campus(streets, ground, tuple(recipes), taken_m=draft.taken_m, **draft.tuples())


def shapes_on(campus: Campus, day: int) -> tuple[Records, Records, Records]:
    """Boxes, cylinders and crowns of everything that stands on `day`; the extinction of porous ones is still 0."""
    plants, ground = campus.plants, campus.ground
    cylinders = np.concatenate([standing(trunks(plants, ground), day), standing(_poles(campus), day)])
    return standing(boxes(campus.structures, ground), day), cylinders, standing(crowns(plants, ground), day)


def _poles(campus: Campus) -> Records:
    if not campus.poles:
        return np.zeros(0, CYLINDER)
    x_m, y_m, radius_m, height_m, dead_day = np.array(
        [(pole.x_m, pole.y_m, pole.radius_m, pole.height_m, pole.dead_day) for pole in campus.poles]
    ).T
    base_m = campus.ground.at(np.stack([x_m, y_m], 1))
    place = {"x_m": x_m, "y_m": y_m, "radius_m": radius_m, "dead_day": dead_day}
    return records(CYLINDER, bottom_m=base_m - 1, top_m=base_m + height_m, reflectance=POLE_REFLECTANCE, kind=Kind.POLE, **place)
