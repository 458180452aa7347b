"""Training routes from a trajectory file, and files that are refused."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from tests.worlds.conftest import SEQUENCES
from tests.worlds.helpers import FLAT, refused
from worlds.driving.drive import SEGWAY, drive
from worlds.layout.routes import read_route
from worlds.layout.streets import distance_to_segments_m
from worlds.simulation import Simulation


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    """A file with a route once around a rectangle of 120 × 60 m, far from the origin."""
    corners = np.array([[5000, -300], [5120, -300], [5120, -240], [5000, -240], [5000, -300]])
    path = tmp_path / "loop.csv"
    path.write_text("x,y\n" + "\n".join(f"{x},{y}" for x, y in corners) + "\n")
    return path


def test_a_route_is_centred_on_the_campus(loop: Path):
    # The rectangle's middle is (60, 30) from its first corner.
    assert read_route(loop)[0] == pytest.approx([-60.0, -30.0])


def test_tum_rows_give_the_same_route(loop: Path, tmp_path: Path):
    rows = np.loadtxt(loop, delimiter=",", skiprows=1)
    tum = tmp_path / "loop.tum"
    tum.write_text(
        "# stamp x y z qx qy qz qw\n"
        + "\n".join(f"{i} {x} {y} 1.5 0 0 0 1" for i, (x, y) in enumerate(rows))
    )
    assert read_route(tum) == pytest.approx(read_route(loop))


def test_the_training_sequence_follows_the_route(small: Simulation, loop: Path):
    replay = replace(small, route_file=str(loop), route_m=1000.0)
    routes = replay.routes()
    assert routes.route_m == pytest.approx(360.0, abs=15.0)
    driven = drive(8, date(2012, 1, 15), routes.training.line_m, FLAT, routes.route_m, 2.0, SEGWAY)
    route = read_route(loop)
    gaps_m = distance_to_segments_m(driven.world_T_body[:, :2, 3], route[:-1], route[1:]).min(1)
    # Up to 3 m beside it, and a little more where corners are cut.
    assert gaps_m.max() < 5.0
    assert driven.length_m > 0.9 * routes.route_m
    test = routes.test(date(2012, 2, 4), SEQUENCES["2012-02-04"])
    assert test.unseen == pytest.approx(0.08, abs=0.08)
    assert test.coverage > 0.5


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x,y\n1,2\n1,spam\n", "expected rows"),
        ("1 2 3\n4 5 6\n", "expected rows"),
        ("", "expected rows"),
        ("1,2\n1,2\n", "two different points"),
        ("1,2\nnan,4\n", "NaN"),
        ("0,0\n5,0\n", "only 5 m long"),
        ("0,0\n9000,0\n", "spans 9000 × 0 m"),
        (None, "cannot be read"),
    ],
)
def test_a_bad_route_file_is_one_line_of_error(
    small: Simulation, tmp_path: Path, text: str | None, complaint: str
):
    path = tmp_path / "route.csv"
    if text is not None:
        path.write_text(text)
    with refused(complaint):
        replace(small, route_file=str(path)).routes()
