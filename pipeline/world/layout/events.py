"""The changes of fifteen months: buildings are built and demolished, trees are felled and planted.

After the heading, the number of such events near the route is what makes a world difficult.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from pipeline.formats.changes import Change, visible
from pipeline.world import Floats
from pipeline.world.layout.campus import Campus
from pipeline.world.layout.greenery import Plant
from pipeline.world.layout.shapes import Kind
from pipeline.world.layout.site import (
    FENCE_BEFORE_DAYS,
    MOUND_BEFORE_DAYS,
    clear_of_streets,
    clear_site,
    fence,
    mound,
)
from pipeline.world.layout.streets import distance_to_segments_m
from pipeline.world.layout.structures import Structure
from pipeline.world.seeds import Stream, generator

PERIOD_DAYS = 450
EVENT_PERIOD_SHARE = (0.1, 0.9)
FURTHER_PERIOD_SHARE = ((FENCE_BEFORE_DAYS + 1) / PERIOD_DAYS, EVENT_PERIOD_SHARE[1])
"""The fences of further events are built after the training day, so that the training day does not
depend on them."""
NEAR_M = 45.0
SITE_OFFSETS_M = (14.0, 40.0)
SITE_TRIES = 300
DEMOLISHED_FROM_M2 = 480.0
TREE_TURNOVER_A_YEAR = 0.03
YOUNG_TREE = 0.45
"""Height and radius of a planted tree relative to a grown one."""


@dataclass(frozen=True)
class Event:
    """One construction or demolition, as year.json lists it."""

    what: str
    """`construction` or `demolition`."""
    day: float
    """Days after training on which the building is complete, or gone."""
    x_m: float
    y_m: float

    @property
    def from_day(self) -> float:
        """Days after training from which the place looks different.

        If the fence stood before, from the mound on.
        """
        before_days = (
            (FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS, 0) if self.what == "construction" else (0,)
        )
        return next(self.day - before for before in before_days if self.day > before)


def simulate_year(
    seed: int,
    campus: Campus,
    route_m: Floats,
    count: int,
    near_share: float,
    further: int = 0,
    further_near: float = 1.0,
) -> tuple[Campus, list[Event]]:
    """The campus with the days on which things appear and vanish, and its `count` events,
    `near_share` of them near the route.

    Half are constructions. One that finds no room within SITE_TRIES becomes a demolition, and the
    reverse; if neither is possible there are fewer events. `further` additional events change
    neither the others nor the training day.
    """
    campus = replace(campus, structures=[*campus.structures], plants=[*campus.plants])
    campus = replace(campus, poles=[*campus.poles], slots=[*campus.slots])
    events = _events(
        generator(seed, Stream.EVENTS), campus, route_m, count, near_share, EVENT_PERIOD_SHARE
    )
    further_rng = generator(seed, Stream.FURTHER_EVENTS)
    events += _events(further_rng, campus, route_m, further, further_near, FURTHER_PERIOD_SHARE)
    _replace_trees(generator(seed, Stream.TREES), campus)
    return campus, events


def _events(
    rng: np.random.Generator,
    campus: Campus,
    route_m: Floats,
    count: int,
    near_share: float,
    period_share: tuple[float, float],
) -> list[Event]:
    """`count` events on random days within a share of the period.

    The first `near_share` of them are near the route.
    """
    events = []
    for number in range(count):
        route = route_m if number < round(near_share * count) else None
        day = float(PERIOD_DAYS * rng.uniform(*period_share))
        first, second = (_construct, _demolish) if number % 2 == 0 else (_demolish, _construct)
        events.append(first(rng, campus, route, day) or second(rng, campus, route, day))
    return [event for event in events if event]


def _construct(
    rng: np.random.Generator, campus: Campus, route_m: Floats | None, day: float
) -> Event | None:
    """Put up a building at a random place with enough room.

    First comes its fence, then a mound, then the building.
    """
    streets = campus.streets
    for _ in range(SITE_TRIES):
        if route_m is None:
            place_m = rng.uniform(streets.nodes_m.min(0), streets.nodes_m.max(0))
        else:
            leg = rng.integers(len(route_m) - 1)
            across = (route_m[leg + 1] - route_m[leg])[::-1] * (-1, 1) * rng.choice([-1, 1])
            on_route_m = route_m[leg] + rng.random() * (route_m[leg + 1] - route_m[leg])
            place_m = on_route_m + across / np.hypot(*across) * rng.uniform(*SITE_OFFSETS_M)
        nearest = int(
            distance_to_segments_m(place_m[None], streets.starts_m, streets.ends_m).argmin()
        )
        along_x, along_y = streets.directions()[0][nearest]
        yaw = float(np.arctan2(along_y, along_x) + rng.integers(4) * np.pi / 2)
        recipe = campus.recipes[rng.integers(len(campus.recipes))]
        building = Structure(float(place_m[0]), float(place_m[1]), yaw, recipe, born_day=day)
        if campus.fits(building) and clear_of_streets(streets, building):
            clear_site(campus, building, day - FENCE_BEFORE_DAYS)
            campus.build(building)
            campus.structures += [fence(building, day), mound(building, day)]
            return Event("construction", day, building.x_m, building.y_m)
    return None


def _demolish(
    rng: np.random.Generator, campus: Campus, route_m: Floats | None, day: float
) -> Event | None:
    """One large building, older than the year, vanishes."""
    buildings = [
        row
        for row, thing in enumerate(campus.structures)
        if thing.kind == Kind.BUILDING
        and thing.born_day < 0
        and thing.dead_day == np.inf
        and 4 * thing.parts[0].half_length_m * thing.parts[0].half_width_m > DEMOLISHED_FROM_M2
    ]
    if route_m is not None and buildings:
        places_m = np.array(
            [(campus.structures[row].x_m, campus.structures[row].y_m) for row in buildings]
        )
        gaps_m = distance_to_segments_m(places_m, route_m[:-1], route_m[1:]).min(1)
        buildings = [row for row, gap_m in zip(buildings, gaps_m, strict=True) if gap_m < NEAR_M]
    if not buildings:
        return None
    row = buildings[rng.integers(len(buildings))]
    gone = campus.structures[row] = replace(campus.structures[row], dead_day=day)
    return Event("demolition", day, gone.x_m, gone.y_m)


def _replace_trees(rng: np.random.Generator, campus: Campus) -> None:
    """The share TREE_TURNOVER_A_YEAR of the trees is felled, or becomes young trees planted, on
    random days."""
    chance = TREE_TURNOVER_A_YEAR * PERIOD_DAYS / 365
    for row, plant in enumerate(campus.plants):
        changes = rng.random() < chance
        felled = rng.random() < 0.5
        day = PERIOD_DAYS * rng.random()
        if not changes or not plant.trunk_m:
            continue
        if felled:
            campus.plants[row] = replace(plant, dead_day=min(plant.dead_day, day))
        else:
            size = {
                name: YOUNG_TREE * getattr(plant, name)
                for name in ("height_m", "trunk_m", "radius_m")
            }
            campus.plants[row] = replace(plant, born_day=day, **size)


def visible_changes(
    day: int, campus: Campus, events: Sequence[Event], origin_m: Sequence[float]
) -> list[Change]:
    """The differences between `day` and the training day.

    They are in a frame in which the origin of the world lies at `origin_m`. A tree is listed with
    the day on which it is felled or planted; the trees cleared for a site are part of that event.
    """
    cleared = {event.day - FENCE_BEFORE_DAYS for event in events if event.what == "construction"}
    dated_things: list[tuple[str, float, float, Event | Plant]]
    dated_things = [(event.what, event.from_day, event.day, event) for event in events]
    grown = [plant for plant in campus.plants if plant.trunk_m and plant.born_day < plant.dead_day]
    dated_things += [
        ("tree", change_day, change_day, tree)
        for tree in grown
        for change_day in {tree.born_day, tree.dead_day} - cleared
        if 0 < change_day < np.inf
    ]
    changes = (
        Change(
            kind,
            ceil(from_day),
            ceil(done_day),
            float(thing.x_m + origin_m[0]),
            float(thing.y_m + origin_m[1]),
        )
        for kind, from_day, done_day, thing in dated_things
    )
    return visible(changes, day)
