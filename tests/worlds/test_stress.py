"""Stress sequences, hard in one way each: what makes them so, and that nothing else changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.helpers import contents, preset, record
from worlds.driving.entry import Entry
from worlds.layout.campus import Campus, shapes_on
from worlds.layout.events import FENCE_BEFORE_DAYS, Event
from worlds.layout.streets import distance_to_segments_m
from worlds.simulation import Simulation

TRAINING = "2012-01-15"
TEST = "2012-02-04"
HEAVY = Entry(0.08, 0.0, events_per_km=120.0)
"""Over the small world's 100 m: 12 events, 8 beyond the world's own 4."""


@pytest.fixture(scope="module")
def default_and_heavy(
    small: Simulation,
) -> tuple[tuple[Campus, list[Event]], tuple[Campus, list[Event]]]:
    return small.year_of(small.routes(), Entry(0.08, 0.0)), small.year_of(small.routes(), HEAVY)


def _looks(campus: Campus, day: int) -> list[np.ndarray]:
    """All shapes that stand on a day, without their own days, and the slots that are open then."""
    shapes = [
        np.stack(
            [shapes[name] for name in shapes.dtype.names if name not in ("born_day", "dead_day")]
        )
        for shapes in shapes_on(campus, day)
    ]
    return [*shapes, np.array([slot.dead_day > day for slot in campus.slots])]


def test_a_heavy_year_begins_on_the_same_training_day(
    default_and_heavy: tuple[tuple[Campus, list[Event]], ...],
):
    (default, _), (heavy, _) = default_and_heavy
    for one, other in zip(_looks(default, 0), _looks(heavy, 0), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(shapes_on(heavy, 426)[0]) != len(shapes_on(default, 426)[0])


def test_a_heavy_year_keeps_the_worlds_own_events_and_has_more_near_the_route(
    small: Simulation, default_and_heavy: tuple[tuple[Campus, list[Event]], ...]
):
    (_, own), (_, events) = default_and_heavy
    further = events[len(own) :]
    assert events[: len(own)] == own
    assert len(own) + 4 <= len(events) <= 12
    line_m = small.routes().training.line_m
    places_m = np.array([(event.x_m, event.y_m) for event in further])
    assert (distance_to_segments_m(places_m, line_m[:-1], line_m[1:]).min(1) < 45.0).all()
    # All happen by day 450 × 0.9, and no fence is up before day 1.
    assert all(FENCE_BEFORE_DAYS + 1 <= event.day <= 405 for event in further)


def test_no_other_sequence_learns_of_a_heavy_one(small: Simulation, tmp_path: Path):
    table = {
        **small.sequences,
        "2013-03-16": {"unseen": 0.08, "reversed": 0.0, "events_per_km": 120.0, "lateral_m": 2.0},
    }
    for name, world in (("without", small), ("with", replace(small, sequences=table))):
        for sequence in (TRAINING, TEST):
            record(world, sequence, tmp_path / name)
    assert contents(tmp_path / "without") == contents(tmp_path / "with")
    # 25 scans, the ground truth, the odometry and its covariance, for both
    assert len(contents(tmp_path / "with")) == 2 * 28


@pytest.mark.parametrize(
    ("name", "reverse"), [("campus_tiny", "2012-01-29"), ("town_tiny", "2014-07-28-14-30-00")]
)
def test_all_reversed_is_all_but_the_crossings(name: str, reverse: str):
    plan = preset(name).plan_of(reverse)[1]
    # At a corner of its route the way across comes within 10 m: about 20 m of each 95 m, when it
    # leads in a like direction.
    assert plan.reversed > 0.9
    assert 0.02 < plan.unseen < 0.15
