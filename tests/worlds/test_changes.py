"""The changes that a world lists for a day, in the frame of its logs."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.formats.changes import Change
from tests.worlds.helpers import EVEN, refused
from worlds.driving.entry import Entry
from worlds.layout.campus import Campus, shapes_on
from worlds.layout.events import Event, visible_changes
from worlds.layout.greenery import Plant
from worlds.layout.shapes import Species
from worlds.simulation import Simulation
from worlds.writers.robotcar import ORIGIN_M

TRAINING = "2012-01-15"
SPRING = "2012-02-04"
SUMMER = "2012-06-15"
HERE = (0.0, 0.0)
"""The origin of the world's frame."""
PLAIN = Entry(0.0, 0.0)


@pytest.fixture(scope="module")
def nobody(campus_and_plan: tuple[Campus, object]) -> Campus:
    """A campus without plants."""
    return replace(campus_and_plan[0], plants=())


@pytest.mark.parametrize(
    ("what", "done", "first"),
    [
        # the fence is up 110 days before: 190.4, so it shows on day 191
        ("construction", 300.4, 191),
        # the fence stood on the training day, the mound comes 70 days before
        ("construction", 90.0, 20),
        ("construction", 60.0, 60),  # the mound lay there too
        ("demolition", 60.0, 60),
    ],
)
def test_a_change_shows_from_its_first_difference(
    nobody: Campus, what: str, done: float, first: int
):
    events = [Event(what, done, 3.0, 4.0)]
    assert visible_changes(first - 1, nobody, events, HERE) == []
    assert visible_changes(first, nobody, events, (10.0, 20.0)) == [
        Change(what, first, int(np.ceil(done)), 13.0, 24.0)
    ]


def test_trees_that_make_room_for_a_site_are_part_of_it(nobody: Campus):
    oak = Plant(1.0, 2.0, 10.0, 3.0, 3.0, Species.DECIDUOUS)
    planted = replace(oak, born_day=30.5)
    felled = replace(oak, x_m=5.0, dead_day=50.0)
    cleared = replace(oak, x_m=6.0, dead_day=190.0)
    bush = replace(oak, trunk_m=0.0, dead_day=60.0)
    grown = replace(nobody, plants=(oak, planted, felled, cleared, bush))
    reported = visible_changes(400, grown, [Event("construction", 300.0, 3.0, 4.0)], HERE)
    assert reported == [
        Change("tree", 31, 31, 1.0, 2.0),
        Change("tree", 50, 50, 5.0, 2.0),
        Change("construction", 190, 300, 3.0, 4.0),
    ]


def test_every_tree_that_came_or_went_is_reported(small: Simulation):
    campus, _ = small.year_of(small.routes(), PLAIN)
    trees = [(one.x_m, one.y_m) for one in small.changes(TRAINING, SUMMER) if one.what == "tree"]
    before, after = (
        {(row["x_m"], row["y_m"]) for row in shapes_on(campus, day)[1]} for day in (0, 152)
    )
    # 15 January to 15 June 2012 are 152 days; trunks are cylinders, as are the lamp posts that a
    # site takes away.
    plants = {(plant.x_m, plant.y_m) for plant in campus.plants}
    assert set(trees) <= before ^ after
    assert len(trees) == len(set(trees)) > 0
    assert set(trees) <= plants


def test_a_building_that_came_or_went_is_where_it_is_reported(small: Simulation):
    late = replace(small, sequences={**small.sequences, "2013-03-16": EVEN})
    campus, events = late.year_of(late.routes(), PLAIN)
    reported = [one for one in late.changes(TRAINING, "2013-03-16") if one.what != "tree"]
    assert {(one.what, one.x_m, one.y_m) for one in reported} == {
        (event.what, event.x_m, event.y_m) for event in events
    }
    assert [one.from_day for one in reported] == sorted(
        int(np.ceil(event.from_day)) for event in events
    )
    before, after = (shapes_on(campus, day)[0] for day in (0, 426))
    for one in reported:
        near = [
            int((np.hypot(boxes["x_m"] - one.x_m, boxes["y_m"] - one.y_m) < 6).sum())
            for boxes in (before, after)
        ]
        assert near[0] != near[1]


def test_nothing_has_changed_on_the_training_day_and_more_by_the_summer(small: Simulation):
    none, few, many = (small.changes(TRAINING, sequence) for sequence in (TRAINING, SPRING, SUMMER))
    assert none == []
    assert set(few) < set(many)
    assert all(0 < one.from_day <= 152 for one in many)


def test_a_town_reports_places_in_the_frame_of_its_ins(small: Simulation):
    drives = {"2014-07-14-14-49-50": EVEN, "2015-06-14-14-00-00": EVEN}
    town = replace(small, robot="push_broom_car", logs="robotcar", sequences=drives)
    campus, _ = town.year_of(town.routes(), PLAIN)
    places_m = {
        (round(thing.x_m, 6), round(thing.y_m, 6)) for thing in (*campus.structures, *campus.plants)
    }
    changes = town.changes(*drives)
    assert len(changes) > 3
    assert {
        (round(one.x_m - ORIGIN_M[0], 6), round(one.y_m - ORIGIN_M[1], 6)) for one in changes
    } <= places_m


def test_a_suburb_of_one_day_changes_nothing():
    table = {"00": {"unseen": 0.1, "reversed": 0.3}}
    suburb = Simulation(2, 4, 960.0, 8.0, 120, table, robot="scanner_car", logs="kitti")
    assert suburb.changes("00-a", "00-b") == []


@pytest.mark.parametrize(("train", "sequence"), [(SPRING, SUMMER), (TRAINING, "2012-01-16")])
def test_changes_are_counted_from_the_worlds_training_day(
    small: Simulation, train: str, sequence: str
):
    with refused(f"{SPRING}|2012-01-16"):
        small.changes(train, sequence)
