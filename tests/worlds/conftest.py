"""Fixtures of all tests of the world: a world small enough for a test, with 3 × 3 blocks."""

import pytest

from worlds.layout.blocks import build_campus
from worlds.layout.campus import Campus
from worlds.layout.plan import Plan
from worlds.simulation import Simulation

SEQUENCES = {
    "2012-01-15": {"unseen": 0.0, "reversed": 0.0},
    "2012-02-04": {"unseen": 0.08, "reversed": 0.0},
    "2012-06-15": {"unseen": 0.2, "reversed": 0.1},
}


@pytest.fixture(scope="session")
def small() -> Simulation:
    """A campus with three sequences of 25 scans, each of 32 × 120 rays."""
    return Simulation(
        seed=8,
        blocks=3,
        route_m=100.0,
        step_m=4.0,
        azimuths=120,
        events_per_km_of_route=40.0,
        sequences=SEQUENCES,
    )


@pytest.fixture(scope="session")
def campus_and_plan(small: Simulation) -> tuple[Campus, Plan]:
    """The campus of the small world, and the plan of its training sequence."""
    routes = small.routes()
    return build_campus(small.seed, small.blocks, routes.streets), routes.training
