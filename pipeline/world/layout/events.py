"""What fifteen months change: buildings go up and come down, trees are felled and planted.

How many such events there are near the route is what makes the world hard, second only to heading.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.campus import Campus
from pipeline.world.layout.draft import Draft
from pipeline.world.layout.shapes import Kind
from pipeline.world.layout.site import FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS, clear, clear_of_streets, fence, mound
from pipeline.world.layout.streets import distance_to_segments_m
from pipeline.world.layout.structures import Structure
from pipeline.world.seeds import Stream, generator

PERIOD_DAYS = 450
EVENT_PERIOD_SHARE = (0.1, 0.9)
FURTHER_PERIOD_SHARE = ((FENCE_BEFORE_DAYS + 1) / PERIOD_DAYS, EVENT_PERIOD_SHARE[1])
"""Further events fence nothing in before the day after training: on the training day their year is the year without them."""
NEAR_M = 45.0
SITE_OFFSETS_M = (14.0, 40.0)
SITE_TRIES = 300
DEMOLISHED_FROM_M2 = 480.0
TREE_TURNOVER_A_YEAR = 0.03
YOUNG_TREE = 0.45
"""A planted tree's height and radius against those of a grown one."""


@dataclass(frozen=True)
class Event:
    """One change, as the truth's side file lists it."""

    what: str
    """`construction` or `demolition`."""
    day: float
    """Days after the training sequence: when the building stands, or is gone."""
    x_m: float
    y_m: float

    @property
    def from_day(self) -> float:
        """When the place first differs from the training day: a site that was fenced in by then changes with its mound."""
        before_days = (FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS, 0) if self.what == "construction" else (0,)
        return next(self.day - before for before in before_days if self.day > before)


def pass_a_year(
    seed: int,
    campus: Campus,
    route_m: NDArray[np.float64],
    count: int,
    near_share: float,
    further: int = 0,
    further_near_share: float = 1.0,
) -> tuple[Campus, list[Event]]:
    """The campus with the days on which things appear and vanish, and the events, `near_share` of them near the route.

    Half are constructions. One that finds no room within SITE_TRIES becomes a demolition, and the other way round; a campus
    that has room for neither gets fewer. `further` events come on top: they leave the others, and the training day, as they are.
    """
    draft = campus.draft()
    here = campus, draft, route_m
    events = _happen(generator(seed, Stream.EVENTS), *here, count, near_share, EVENT_PERIOD_SHARE)
    events += _happen(generator(seed, Stream.FURTHER_EVENTS), *here, further, further_near_share, FURTHER_PERIOD_SHARE)
    _turn_over_trees(generator(seed, Stream.TREES), draft)
    lists = tuple(draft.structures), tuple(draft.plants), tuple(draft.poles), tuple(draft.slots)
    return replace(campus, structures=lists[0], plants=lists[1], poles=lists[2], slots=lists[3]), events


def _happen(
    rng: np.random.Generator,
    campus: Campus,
    draft: Draft,
    route_m: NDArray[np.float64],
    count: int,
    near_share: float,
    period_share: tuple[float, float],
) -> list[Event]:
    """Events on days within a share of the period, the first of them near the route."""
    events = []
    for number in range(count):
        near = number < round(near_share * count)
        day = float(PERIOD_DAYS * rng.uniform(*period_share))
        makers = (_construct, _demolish) if number % 2 == 0 else (_demolish, _construct)
        route = route_m if near else None
        event = makers[0](rng, campus, draft, route, day) or makers[1](rng, campus, draft, route, day)
        if event:
            events.append(event)
    return events


def _construct(
    rng: np.random.Generator, campus: Campus, draft: Draft, route_m: NDArray[np.float64] | None, day: float
) -> Event | None:
    """A building where there is room for it: fence first, then a mound, then the building."""
    streets = campus.streets
    low_m, high_m = streets.nodes_m.min(0), streets.nodes_m.max(0)
    for _ in range(SITE_TRIES):
        if route_m is None:
            place_m = rng.uniform(low_m, high_m)
        else:
            leg = rng.integers(len(route_m) - 1)
            across = (route_m[leg + 1] - route_m[leg])[::-1] * (-1, 1) * rng.choice([-1, 1])
            on_route_m = route_m[leg] + rng.random() * (route_m[leg + 1] - route_m[leg])
            place_m = on_route_m + across / np.hypot(*across) * rng.uniform(*SITE_OFFSETS_M)
        nearest = int((distance_to_segments_m(place_m[None], streets.starts_m, streets.ends_m)).argmin())
        along = streets.directions()[0][nearest]
        yaw = float(np.arctan2(along[1], along[0]) + rng.integers(4) * np.pi / 2)
        recipe = campus.recipes[rng.integers(len(campus.recipes))]
        building = Structure(float(place_m[0]), float(place_m[1]), yaw, recipe, born_day=day)
        if draft.fits(building) and clear_of_streets(streets, building):
            clear(draft, building, day - FENCE_BEFORE_DAYS)
            draft.build(building)
            draft.structures += [fence(building, day), mound(building, day)]
            return Event("construction", day, building.x_m, building.y_m)
    return None


def _demolish(
    rng: np.random.Generator, campus: Campus, draft: Draft, route_m: NDArray[np.float64] | None, day: float
) -> Event | None:
    """One large building, standing since before the year, vanishes."""
    buildings = [
        row
        for row, thing in enumerate(draft.structures)
        if thing.kind == Kind.BUILDING
        and thing.born_day < 0
        and thing.dead_day == np.inf
        and 4 * thing.parts[0].half_length_m * thing.parts[0].half_width_m > DEMOLISHED_FROM_M2
    ]
    if route_m is not None and buildings:
        places_m = np.array([(draft.structures[row].x_m, draft.structures[row].y_m) for row in buildings])
        gaps_m = distance_to_segments_m(places_m, route_m[:-1], route_m[1:]).min(1)
        buildings = [row for row, gap_m in zip(buildings, gaps_m, strict=True) if gap_m < NEAR_M]
    if not buildings:
        return None
    row = buildings[rng.integers(len(buildings))]
    gone = draft.structures[row] = replace(draft.structures[row], dead_day=day)
    return Event("demolition", day, gone.x_m, gone.y_m)


def _turn_over_trees(rng: np.random.Generator, draft: Draft) -> None:
    """TREE_TURNOVER_A_YEAR of the trees are felled on some day, or turn out to be young ones planted then."""
    chance = TREE_TURNOVER_A_YEAR * PERIOD_DAYS / 365
    for row, plant in enumerate(draft.plants):
        changes, felled, day = rng.random() < chance, rng.random() < 0.5, PERIOD_DAYS * rng.random()
        if not changes or not plant.trunk_m:
            continue
        if felled:
            draft.plants[row] = replace(plant, dead_day=min(plant.dead_day, day))
        else:
            size = {name: YOUNG_TREE * getattr(plant, name) for name in ("height_m", "trunk_m", "radius_m")}
            draft.plants[row] = replace(plant, born_day=day, **size)
