"""A training day of level sweeps gives the queries of another drive poses and error
probabilities."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.frames import LEVEL_RIGHT_WITHIN
from pipeline.core.grid import Grid
from pipeline.level.day import LevelDay
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.level.verdict import OF_SWEEPS
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.posing.answers import PosedQuery, posed
from pipeline.posing.verdict import CLAIMS
from tests.level.hall import drive
from tests.posing.scene import scene
from tests.views.made import artifacts

LIFT_M = 7.0
"""Height to which the reader of CARMEN logs lifts sweeps, so that views show them."""
PLACES = Places(Grid(10.0, (0.0, 20.0), (0.0, 20.0)), np.arange(4))


def scans(folder: Path, seed: int, step_m: float) -> schemas.Scans:
    """The scans of a drive through the hall."""
    sweeps = drive(seed=seed, step_m=step_m)
    lifted = [
        np.column_stack([sweeps.points(row), np.full(len(sweeps.points(row)), LIFT_M)])
        for row in range(len(sweeps.world_T_sweep))
    ]
    folder.mkdir()
    artifacts(folder, lifted, sweeps.world_T_sweep, sweeps.odom_T_sweep)
    return store.read(folder / "scans.zarr", schemas.Scans)


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> LevelDay:
    trained = scans(tmp_path_factory.mktemp("hall") / "monday", 0, 1.0)
    sweeps = Sweeps.of(trained, is_posed=True)
    assert sweeps.is_level
    return LevelDay.of(sweeps, 0.2, LevelValidation(most=6))


@pytest.fixture(scope="module")
def tuesday(tmp_path_factory: pytest.TempPathFactory) -> schemas.Scans:
    return scans(tmp_path_factory.mktemp("hall") / "tuesday", 5, 0.5)


def test_queries_of_another_drive_have_poses_near_the_ground_truth(
    day: LevelDay, tuesday: schemas.Scans
) -> None:
    rows = np.array([20, 30, 40])
    queries = day.queries(tuesday, rows)
    poses = np.array([query.pose for query in queries])
    assert OF_SWEEPS.right(poses, tuesday.load("world_T_scan")[rows]).all()
    for query in queries:
        assert query.covariance.shape == (6, 6)
        assert query.error_probabilities.shape == (len(CLAIMS),)
        assert query.error_probabilities[0] < 0.1
        assert query.overlap > 0.8
        assert query.probabilities.sum() <= 1 + 1e-9
    assert LEVEL_RIGHT_WITHIN == (1.0, 10.0)


def test_poses_of_sweeps_come_first_in_the_ranking_like_those_of_3_d_scans(
    day: LevelDay, tuesday: schemas.Scans
) -> None:
    """At row 30 the robot stands in the cell of x 10 to 20, y 0 to 10, which is place 1 or 2."""
    (query,) = day.queries(tuesday, np.array([30]))
    ranking = Ranking(
        np.array([[0, 3]]),
        np.array([[0.1, 0.2]], np.float32),
        np.zeros((1, 2, 2)),
        np.array([[0.5]], np.float32),
        np.full(1, np.nan, np.float32),
        np.full((1, 2), np.nan, np.float32),
        ("distance",),
    )
    answered = posed(ranking, [query], PLACES)
    true_m = tuesday.load("world_T_scan")[30, :2, 3]
    assert answered.places[0, 0] == PLACES.at(true_m[None])[0]
    assert np.linalg.norm(answered.xy_m[0, 0] - true_m) < 0.2
    assert answered.kinds == (*CLAIMS, "distance")


def test_poses_of_a_laser_upside_down_are_not_accepted(
    day: LevelDay, tuesday: schemas.Scans
) -> None:
    sweeps = Sweeps.of(tuesday)
    mirrored = Sweeps(
        lambda row: np.asarray(sweeps.points(row)) * (1, -1, 1),
        sweeps.world_T_sweep,
        np.full_like(sweeps.odom_T_sweep, np.nan),
    )
    queries = [query_of(day, mirrored, row) for row in (20, 30, 40)]
    assert min(query.error_probabilities[0] for query in queries) > 0.5


def query_of(day: LevelDay, sweeps: Sweeps, row: int) -> PosedQuery:
    """The poses of one sweep and their error probabilities."""
    return day.query(sweeps.gathered([row], 5.0)[row])


def test_scans_of_several_heights_are_not_level(tmp_path: Path) -> None:
    artifacts(tmp_path, [scene(0), scene(1)], np.stack([np.eye(4)] * 2))
    assert not Sweeps.of(store.read(tmp_path / "scans.zarr", schemas.Scans)).is_level
