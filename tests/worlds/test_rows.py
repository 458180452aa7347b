"""Worlds that repeat: equal houses or pillars at equal distances along every street."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.helpers import preset
from worlds.driving.entry import Entry
from worlds.layout.blocks import build_campus
from worlds.layout.campus import Campus, shapes_on
from worlds.layout.rows import OF_LINING
from worlds.layout.shapes import Kind, Records
from worlds.simulation import Simulation

REPEATED = {"terraces": (0.4, 0.8), "colonnade": (0.35, 0.35)}
"""Half length and half width of what each unit has one of: its chimney, and its pillar."""
UNITS_M = {"terraces": 6.0, "colonnade": 4.0}
FACADES_M = {"terraces": 4.0, "colonnade": 8.0}
"""Distance between the border of the street and the walls."""


@pytest.fixture(scope="module", params=REPEATED)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def campus(kind: str, small: Simulation) -> Campus:
    """The small world, lined with rows."""
    return build_campus(small.seed, small.blocks, small.routes().streets, kind)


def repeated(kind: str, boxes: Records) -> Records:
    """The boxes that each unit has one of."""
    half_length_m, half_width_m = REPEATED[kind]
    return boxes[
        (boxes["half_length_m"] == half_length_m) & (boxes["half_width_m"] == half_width_m)
    ]


def test_units_of_a_row_stand_at_equal_distances(kind: str, campus: Campus):
    # Boxes of one row have the same heading and lie equally far across it, to the millimetre.
    found = repeated(kind, shapes_on(campus, 0)[0])
    ahead = np.stack([found["cos_yaw"], found["sin_yaw"]], 1)
    places_m = np.stack([found["x_m"], found["y_m"]], 1)
    along_m = (places_m * ahead).sum(1)
    across_m = places_m[:, 1] * ahead[:, 0] - places_m[:, 0] * ahead[:, 1]
    keys = np.round(np.column_stack([ahead, across_m]), 3)
    rows, number, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    assert len(rows) > 20
    assert counts.min() >= 4
    for row in range(len(rows)):
        steps_m = np.diff(np.sort(along_m[number.ravel() == row]))
        assert steps_m == pytest.approx(UNITS_M[kind])


def test_every_row_is_as_high_and_as_far_from_its_street_as_any_other(kind: str, campus: Campus):
    boxes = shapes_on(campus, 0)[0]
    found = repeated(kind, boxes)
    assert np.ptp(found["top_m"]) == pytest.approx(0.0)
    walls = [thing for thing in campus.structures if thing.kind == Kind.BUILDING]
    for building in walls:
        body = building.parts[0]
        # The middle of the front; x of a row is along its street, y points away from it.
        middle_m = building.to_world(np.array([[0.0, -body.half_width_m]]))
        assert campus.streets.clearance_m(middle_m) == pytest.approx(FACADES_M[kind])


def test_nothing_of_a_row_stands_on_a_street(campus: Campus):
    for building in campus.structures:
        whole = replace(building, parts=building.parts + campus.fronts.get(building.parts, ()))
        assert (campus.streets.clearance_m(whole.footprint_m()) > 0).all()


def test_the_ground_is_flat_and_trees_are_few(campus: Campus, small: Simulation):
    assert np.ptp(campus.ground.heights_m) == 0.0
    assert len(campus.plants) <= 2 * small.blocks**2


def test_what_is_built_in_the_year_is_more_of_the_same(kind: str, small: Simulation):
    world = replace(small, lining=kind, route_m=400.0)
    campus, events = world.year_of(world.routes(), Entry(0.0, 0.0))
    assert {event.what for event in events} == {"construction", "demolition"}
    built = [
        thing
        for thing in campus.structures
        if thing.kind == Kind.BUILDING and np.isfinite(thing.born_day)
    ]
    assert built
    for building in built:
        assert building.parts == OF_LINING[kind].body(10)
        assert building.parts in campus.fronts


def test_the_worlds_that_repeat_drive_the_demos_days(kind: str):
    world = preset(f"campus_{kind}")
    demo = preset("campus_demo")
    assert world.lining == kind
    assert world.sequences == demo.sequences
    assert replace(world, seed=demo.seed, route_m=demo.route_m, lining=demo.lining) == demo
