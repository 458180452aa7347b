"""The events of a year: building sites, demolished buildings, and trees that change."""

import numpy as np
import pytest

from worlds.layout.campus import Campus, shapes_on
from worlds.layout.events import FENCE_BEFORE_DAYS, MOUND_BEFORE_DAYS, Event, simulate_year
from worlds.layout.plan import Plan
from worlds.layout.shapes import Kind
from worlds.layout.streets import distance_to_segments_m


@pytest.fixture(scope="module")
def year(campus_and_plan: tuple[Campus, Plan]) -> tuple[Campus, list[Event]]:
    campus, plan = campus_and_plan
    return simulate_year(8, campus, plan.line_m, 6, 1.0)


def _boxes_at(campus: Campus, event: Event, day: float, kind: Kind) -> int:
    boxes = shapes_on(campus, int(day))[0]
    near = np.hypot(boxes["x_m"] - event.x_m, boxes["y_m"] - event.y_m) < 6.0
    return int((near & (boxes["kind"] == kind)).sum())


def _first(events: list[Event], what: str) -> Event:
    return next(event for event in events if event.what == what)


def test_a_mound_gives_way_to_a_new_building(year: tuple[Campus, list[Event]]):
    campus, events = year
    built = _first(events, "construction")
    mound_day = built.day - MOUND_BEFORE_DAYS
    assert [
        _boxes_at(campus, built, day, Kind.WORKS)
        for day in (mound_day - 2, mound_day + 2, built.day + 2)
    ] == [0, 1, 0]
    assert (
        _boxes_at(campus, built, built.day - 2, Kind.BUILDING)
        == 0
        < _boxes_at(campus, built, built.day + 2, Kind.BUILDING)
    )


def test_a_site_is_fenced_in_and_no_fence_crosses_a_street(year: tuple[Campus, list[Event]]):
    campus, events = year
    built = _first(events, "construction")
    boards = [
        thing for thing in campus.structures if thing.kind == Kind.WORKS and len(thing.parts) == 4
    ]
    fence = next(thing for thing in boards if (thing.x_m, thing.y_m) == (built.x_m, built.y_m))
    assert fence.born_day == built.day - FENCE_BEFORE_DAYS
    for board in boards:
        u, v = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60))
        for part in board.parts:
            places = np.stack(
                [part.ahead_m + u * part.half_length_m, part.left_m + v * part.half_width_m], -1
            ).reshape(-1, 2)
            assert campus.streets.clearance_m(board.to_world(places)).min() > 0


def test_a_demolished_building_is_gone(year: tuple[Campus, list[Event]]):
    campus, events = year
    gone = _first(events, "demolition")
    assert _boxes_at(campus, gone, gone.day - 2, Kind.BUILDING) > 0
    assert _boxes_at(campus, gone, gone.day + 2, Kind.BUILDING) == 0


def test_events_near_the_route_are_near_the_route(
    year: tuple[Campus, list[Event]], campus_and_plan: tuple[Campus, Plan]
):
    line_m = campus_and_plan[1].line_m
    places_m = np.array([(event.x_m, event.y_m) for event in year[1]])
    # Sites lie up to 40 m beside the route, demolished buildings up to 45 m.
    assert (distance_to_segments_m(places_m, line_m[:-1], line_m[1:]).min(1) < 45.0).all()


def test_a_few_trees_in_a_hundred_change(year: tuple[Campus, list[Event]]):
    plants = [plant for plant in year[0].plants if plant.trunk_m]
    planted = sum(plant.born_day > 0 for plant in plants)
    felled = sum(plant.dead_day < 450 for plant in plants)
    # 3 % a year over 450 days are 3.7 %, and the sites swallow some more.
    assert 0.01 < (planted + felled) / len(plants) < 0.25
    assert len(shapes_on(year[0], 0)[2]) != len(shapes_on(year[0], 449)[2])
