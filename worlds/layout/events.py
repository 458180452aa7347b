"""The changes of fifteen months: the campus of the training day in, the campus over the year out.

Buildings are built and demolished, trees are felled and planted. Each thing gets the days on which
it appears and vanishes, so that the campus of any day follows. How many buildings change near the
route decides, after the heading, how difficult a world is to localise in.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from pipeline.formats.changes import Change, visible
from worlds import Floats
from worlds.layout.campus import Campus
from worlds.layout.greenery import Plant
from worlds.layout.shapes import Kind
from worlds.layout.site import (
    FENCE_BEFORE_DAYS,
    MOUND_BEFORE_DAYS,
    clear_of_streets,
    clear_site,
    fence,
    mound,
)
from worlds.layout.streets import distance_to_segments_m
from worlds.layout.structures import Structure
from worlds.seeds import Stream, generator

PERIOD_DAYS = 450
"""The period that is simulated, fifteen months from the training day on."""
EVENT_SHARE_BOUNDS = (0.1, 0.9)
"""Events happen between these shares of the period."""
FURTHER_SHARE_BOUNDS = ((FENCE_BEFORE_DAYS + 1) / PERIOD_DAYS, EVENT_SHARE_BOUNDS[1])
"""Further events happen between these shares. Their fences are built after the training day, so
that it does not depend on them."""
NEAR_M = 45.0
"""A demolished building is near the route if its middle is nearer than this."""
SITE_OFFSET_BOUNDS_M = (14.0, 40.0)
"""Bounds of the distance between the route and the middle of a building site near it."""
SITE_TRIES = 300
"""Number of random places at which a building site is tried."""
DEMOLISHED_FROM_M2 = 480.0
"""Least ground area of the main wing of a building that may be demolished."""
TREE_TURNOVER_A_YEAR = 0.03
"""Share of the trees that are felled or planted in a year."""
YOUNG_TREE_SCALE = 0.45
"""Height and radius of a planted tree relative to a full-grown one."""


@dataclass(frozen=True)
class Event:
    """One construction or demolition, as the ground truth's file year.json lists it."""

    what: str
    """`construction` or `demolition`."""
    day: float
    """Days after training on which the building is complete, or gone."""
    x_m: float
    y_m: float

    @property
    def from_day(self) -> float:
        """The first day after training on which the place looks different.

        Before a building stands there is a fence, then a mound. What stood on the training day
        already is no difference.
        """
        if self.what == "construction":
            for before_days in (FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS):
                if self.day > before_days:
                    return self.day - before_days
        return self.day


def simulate_year(
    seed: int,
    campus: Campus,
    route_m: Floats,
    count: int,
    near_share: float,
    further: int = 0,
    further_near: float = 1.0,
) -> tuple[Campus, list[Event]]:
    """Simulate `count` events, the share `near_share` of them near the route (n, 2).

    Returns a new campus, whose things have the days on which they stand, and the events. Every
    second event is a construction. One that finds no room becomes a demolition, and the reverse; if
    neither is possible there is one event less. `further` additional events, the share
    `further_near` of them near the route, change neither the others nor the training day.
    """
    campus = replace(
        campus,
        structures=[*campus.structures],
        plants=[*campus.plants],
        poles=[*campus.poles],
        slots=[*campus.slots],
    )
    events = _events(
        generator(seed, Stream.EVENTS), campus, route_m, count, near_share, EVENT_SHARE_BOUNDS
    )
    further_rng = generator(seed, Stream.FURTHER_EVENTS)
    events += _events(further_rng, campus, route_m, further, further_near, FURTHER_SHARE_BOUNDS)
    _replace_trees(generator(seed, Stream.TREES), campus)
    return campus, events


def _events(
    rng: np.random.Generator,
    campus: Campus,
    route_m: Floats,
    count: int,
    near_share: float,
    share_bounds: tuple[float, float],
) -> list[Event]:
    """Change the campus by at most `count` events on random days between two shares of the period.

    The first ones, `near_share` of all, are near the route.
    """
    events = []
    n_near = round(near_share * count)
    for number in range(count):
        near_route_m = route_m if number < n_near else None
        day = float(PERIOD_DAYS * rng.uniform(*share_bounds))
        if number % 2 == 0:
            event = _construct(rng, campus, near_route_m, day) or _demolish(
                rng, campus, near_route_m, day
            )
        else:
            event = _demolish(rng, campus, near_route_m, day) or _construct(
                rng, campus, near_route_m, day
            )
        if event:
            events.append(event)
    return events


def _construct(
    rng: np.random.Generator, campus: Campus, route_m: Floats | None, day: float
) -> Event | None:
    """Put up a building at a random place with enough room, near the route if one is given."""
    streets = campus.streets
    for _ in range(SITE_TRIES):
        if route_m is None:
            place_m = rng.uniform(streets.nodes_m.min(0), streets.nodes_m.max(0))
        else:
            place_m = _beside_route(rng, route_m)
        # Its walls are parallel to the nearest street.
        nearest = int(
            distance_to_segments_m(place_m[None], streets.starts_m, streets.ends_m).argmin()
        )
        along, _ = streets.directions()
        along_x, along_y = along[nearest]
        yaw_rad = float(np.arctan2(along_y, along_x) + rng.integers(4) * np.pi / 2)
        template = campus.templates[rng.integers(len(campus.templates))]
        x_m, y_m = place_m.tolist()
        building = Structure(x_m, y_m, yaw_rad, template, born_day=day)
        if campus.fits(building) and clear_of_streets(streets, building):
            clear_site(campus, building, day - FENCE_BEFORE_DAYS)
            campus.build(building)
            campus.structures += [fence(building, day), mound(building, day)]
            return Event("construction", day, building.x_m, building.y_m)
    return None


def _beside_route(rng: np.random.Generator, route_m: Floats) -> Floats:
    """A random place (2,) on either side of a random leg of the route (n, 2)."""
    leg = rng.integers(len(route_m) - 1)
    along_m = route_m[leg + 1] - route_m[leg]
    across_m = along_m[::-1] * (-1, 1) * rng.choice([-1, 1])  # along_m turned by 90° either way
    on_route_m = route_m[leg] + rng.random() * along_m
    offset_m = rng.uniform(*SITE_OFFSET_BOUNDS_M)
    return np.asarray(on_route_m + across_m / np.hypot(*across_m) * offset_m)


def _demolish(
    rng: np.random.Generator, campus: Campus, route_m: Floats | None, day: float
) -> Event | None:
    """Demolish a random large building that stands all year, near the route if one is given."""
    buildings = [
        row
        for row, thing in enumerate(campus.structures)
        if thing.kind == Kind.BUILDING
        and thing.born_day < 0
        and thing.dead_day == np.inf
        and _ground_m2(thing) > DEMOLISHED_FROM_M2
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
    demolished = replace(campus.structures[row], dead_day=day)
    campus.structures[row] = demolished
    return Event("demolition", day, demolished.x_m, demolished.y_m)


def _ground_m2(building: Structure) -> float:
    """Ground area of a building's main wing."""
    main_wing = building.parts[0]
    return 4 * main_wing.half_length_m * main_wing.half_width_m


def _replace_trees(rng: np.random.Generator, campus: Campus) -> None:
    """Fell a share of the trees on random days, and let as many others be planted then."""
    change_probability = TREE_TURNOVER_A_YEAR * PERIOD_DAYS / 365
    for row, plant in enumerate(campus.plants):
        has_changed = rng.random() < change_probability
        is_felled = rng.random() < 0.5
        day = PERIOD_DAYS * rng.random()
        is_tree = plant.trunk_m > 0
        if not has_changed or not is_tree:
            continue
        if is_felled:
            campus.plants[row] = replace(plant, dead_day=min(plant.dead_day, day))
        else:
            campus.plants[row] = replace(
                plant,
                born_day=day,
                height_m=YOUNG_TREE_SCALE * plant.height_m,
                trunk_m=YOUNG_TREE_SCALE * plant.trunk_m,
                radius_m=YOUNG_TREE_SCALE * plant.radius_m,
            )


def visible_changes(
    day: int, campus: Campus, events: Sequence[Event], origin_m: Sequence[float]
) -> list[Change]:
    """List the differences between `day` and the training day.

    Their positions are in a frame in which the origin of the world lies at `origin_m`. A tree is
    listed with the day on which it is felled or planted, except those that are cleared for a
    building site: they belong to that event.
    """

    def change(kind: str, from_day: float, done_day: float, thing: Event | Plant) -> Change:
        x_m = float(thing.x_m + origin_m[0])
        y_m = float(thing.y_m + origin_m[1])
        return Change(kind, ceil(from_day), ceil(done_day), x_m, y_m)

    changes = [change(event.what, event.from_day, event.day, event) for event in events]
    cleared_days = {
        event.day - FENCE_BEFORE_DAYS for event in events if event.what == "construction"
    }
    for plant in campus.plants:
        is_tree = plant.trunk_m > 0
        if not is_tree or plant.born_day >= plant.dead_day:
            continue
        for change_day in {plant.born_day, plant.dead_day} - cleared_days:
            if 0 < change_day < np.inf:
                changes.append(change("tree", change_day, change_day, plant))
    return visible(changes, day)
