"""Route plans: the shares of a route that are unseen or reversed, and loops."""

from datetime import date

import numpy as np
import pytest

from tests.worlds.helpers import shares
from worlds.driving.drive import SEGWAY, drive
from worlds.layout.ground import rolling_ground
from worlds.layout.plan import plan_loops, plan_test, plan_training
from worlds.layout.streets import build_streets
from worlds.seeds import Stream, generator

ROUTE_M = 1200.0
STREETS = build_streets(generator(0, Stream.STREETS), 8)
TRAINING = plan_training(generator(0, Stream.TRAINING_PLAN), STREETS, ROUTE_M)


def test_no_corner_is_a_dead_end():
    assert np.bincount(STREETS.edges.ravel()).min() >= 2


def test_the_training_plan_repeats_no_street():
    streets = [step // 2 for step in TRAINING.half_edges]
    assert len(set(streets)) == len(streets)


@pytest.mark.parametrize(("unseen", "reversed_"), [(0.079, 0.0), (0.166, 0.3), (0.265, 0.15)])
def test_a_test_plan_has_the_wanted_shares(unseen: float, reversed_: float):
    plan = plan_test(
        generator(0, Stream.TEST_PLAN, date(2012, 2, 4)),
        STREETS,
        TRAINING,
        ROUTE_M,
        unseen,
        reversed_,
    )
    assert (plan.unseen, plan.reversed) == pytest.approx((unseen, reversed_), abs=0.05)
    assert plan.coverage > 0.5


def test_the_driven_shares_are_the_planned_ones():
    plan = plan_test(
        generator(0, Stream.TEST_PLAN, date(2012, 2, 4)), STREETS, TRAINING, ROUTE_M, 0.2, 0.3
    )
    ground = rolling_ground(
        np.random.default_rng(0), STREETS.nodes_m.min(0), STREETS.nodes_m.max(0)
    )
    paths = []
    for day, line_m in ((date(2012, 1, 15), TRAINING.line_m), (date(2012, 2, 4), plan.line_m)):
        driven = drive(0, day, line_m, ground, ROUTE_M, 2.0, SEGWAY)
        paths.append(driven.world_T_body[driven.scan_rows])
    assert shares(paths[1], paths[0]) == pytest.approx((plan.unseen, plan.reversed), abs=0.05)


@pytest.mark.parametrize(("unseen", "reversed_"), [(0.1, 0.0), (0.15, 0.4)])
def test_loops_are_driven_again(unseen: float, reversed_: float):
    plan = plan_loops(generator(0, Stream.LOOPS), STREETS, ROUTE_M, unseen, reversed_)
    assert (plan.unseen, plan.reversed) == pytest.approx((unseen, reversed_), abs=0.05)
    assert plan.coverage > 0.5
    # By hand: the second half's streets, located by their middles, against the streets of
    # the first half.
    steps = np.array(plan.half_edges)
    lengths_m = STREETS.lengths_m[steps // 2]
    middles_m = np.cumsum(lengths_m) - lengths_m / 2
    second = (middles_m > ROUTE_M / 2) & (middles_m < ROUTE_M)
    again = np.isin(steps[second] // 2, steps[middles_m < ROUTE_M / 2] // 2)
    assert lengths_m[second][again].sum() / lengths_m[second].sum() == pytest.approx(
        1 - unseen, abs=0.2
    )
    tails = STREETS.edges.ravel()
    heads = STREETS.edges[:, ::-1].ravel()
    assert (heads[steps[:-1]] == tails[steps[1:]]).all()


def test_a_route_shorter_than_a_street_has_a_test_plan():
    training = plan_training(generator(0, Stream.TRAINING_PLAN), STREETS, 20.0)
    plan = plan_test(
        generator(0, Stream.TEST_PLAN, date(2012, 2, 4)), STREETS, training, 20.0, 0.0, 0.0
    )
    assert (plan.unseen, plan.reversed) == (0.0, 0.0)
