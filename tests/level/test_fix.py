"""Fixes of gathered sweeps: their precision, and the evidence of beams and odometry."""

import numpy as np
import pytest

from pipeline.level.beams import supports
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import LevelMap
from pipeline.level.refinement import refined
from pipeline.level.sweeps import Gatherer, single
from pipeline.level.verdict import OF_SWEEPS
from tests.level import hall
from tests.level.hall import WALLS, drive, pose, sweep


@pytest.fixture(scope="module")
def field() -> Field:
    return hall.field()


PLACES = ((4.0, 3.0, 0.3), (16.0, 6.0, 2.0), (13.0, 9.5, -2.5), (9.5, 4.0, 3.0))


@pytest.mark.parametrize("place", PLACES)
def test_a_sweep_is_found_to_less_than_a_cell(
    field: Field, place: tuple[float, float, float]
) -> None:
    points_m = sweep(*place, noise=np.random.default_rng(7))
    fix = LevelFixer().fix(field, single(points_m))
    best = fix.hypotheses[0]
    assert np.linalg.norm(best.world_T_query[:2, 3] - place[:2]) < 0.06
    turn = np.arctan2(best.world_T_query[1, 0], best.world_T_query[0, 0]) - place[2]
    assert abs(np.rad2deg(turn)) < 1
    assert best.support.explained > 0.9
    assert best.support.contradicted < 0.05
    rows = fix.features
    assert rows[0, -1] > 0
    assert (rows[1:, -1] < 0).all()


def test_a_map_whose_grid_is_turned_in_the_world_gives_the_same_poses(field: Field) -> None:
    place = PLACES[0]
    points_m = sweep(*place)
    turned = pose(5.0, -3.0, 0.7)
    other = Field(
        field.cell_m,
        field.distance_m,
        field.walls,
        field.free,
        turned @ field.world_T_grid,
    )
    fix = LevelFixer().fix(field, single(points_m))
    turned_fix = LevelFixer().fix(other, single(points_m))
    np.testing.assert_allclose(
        turned_fix.hypotheses[0].world_T_query,
        turned @ fix.hypotheses[0].world_T_query,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        np.linalg.eigvalsh(turned_fix.hypotheses[0].covariance),
        np.linalg.eigvalsh(fix.hypotheses[0].covariance),
        rtol=1e-6,
    )


def test_in_a_corridor_a_pose_is_certain_across_it_and_uncertain_along_it() -> None:
    cells = np.zeros((62, 400), np.int8)
    cells[[0, -1]] = 100
    corridor = Field.of(LevelMap(cells, 0.05, (0.0, 0.0, 0.0)))
    along = np.linspace(-3, 3, 60)
    points_m = np.concatenate([np.column_stack([along, np.full(60, side)]) for side in (-1.5, 1.5)])
    _, covariances = refined(corridor, points_m, np.array([[10.0, 1.55, 0.0]]))
    sd_m = np.sqrt(np.diag(covariances[0])[:2])
    assert sd_m[1] < 0.1
    assert sd_m[0] > 10 * sd_m[1]


def test_beams_through_a_wall_and_beams_that_end_in_free_space_contradict_a_pose(
    field: Field,
) -> None:
    # from (3, 3) looking along x the wall at x = 7 stands 4 m away; ranges of 8 m pass it
    beams = np.column_stack([np.full(9, 8.0), np.linspace(-0.5, 0.5, 9)])
    inside = np.column_stack([np.full(9, 2.0), np.linspace(-0.5, 0.5, 9)])
    here = np.linalg.inv(field.world_T_grid) @ pose(3.0, 2.5, 0.0)
    poses = np.array([[here[0, 3], here[1, 3], 0.0]])
    assert supports(field, single(beams), poses)[0].through == 1.0
    assert supports(field, single(inside), poses)[0].in_free == 1.0


def test_matching_corrects_the_odometry() -> None:
    sweeps = drive()
    last = 20
    off_m = []
    for corrects_odometry in (False, True):
        gatherer = Gatherer(corrects_odometry)
        for row in range(last + 1):
            gatherer.add(np.asarray(sweeps.points(row), np.float64), sweeps.step(row))
        oldest = gatherer.gathered(5.0).starts_m[-1]
        path_m = np.linalg.norm(np.diff(sweeps.world_T_sweep[: last + 1, :2, 3], axis=0), axis=1)
        first = last - int((np.cumsum(path_m[::-1]) <= 5.0).sum())
        last_T_first = np.linalg.inv(sweeps.world_T_sweep[last]) @ sweeps.world_T_sweep[first]
        off_m.append(np.linalg.norm(oldest - last_T_first[:2, 3]))
    assert off_m[1] < 0.15
    assert off_m[1] < off_m[0] / 2


def test_without_odometry_earlier_sweeps_are_forgotten() -> None:
    gatherer = Gatherer()
    for place in PLACES:
        gatherer.add(sweep(*place), None)
    gathered = gatherer.gathered(5.0)
    assert gathered.path_m == 0
    assert len(gathered.ends_m) == len(sweep(*PLACES[-1]))
    gatherer.add(sweep(*PLACES[-1]), np.full((4, 4), np.nan))
    assert gatherer.gathered(5.0).path_m == 0


def test_earlier_sweeps_are_forgotten_where_odometry_does_not_join_a_sweep_with_them() -> None:
    """In the middle of the drive the robot is carried by 4 m, and odometry does not notice."""
    sweeps = drive()
    gatherer = Gatherer()
    for row in (*range(10), *range(18, 21)):
        gatherer.add(np.asarray(sweeps.points(row), np.float64), sweeps.step(row))
    gathered = gatherer.gathered(5.0)
    assert gathered.path_m == pytest.approx(1.0, abs=0.2)  # rows 18 to 20, .5 m apart
    assert not gathered.is_contradicted  # one of ten


@pytest.mark.parametrize("mounted", ["turned", "upside down", "as said"])
def test_odometry_contradicts_a_laser_that_is_mounted_otherwise(mounted: str, field: Field) -> None:
    """To a laser that looks to the right, the robot seems to drive to the left."""
    robot_T_seen = {
        "turned": np.array([[0.0, 1.0], [-1.0, 0.0]]),
        "upside down": np.diag([1.0, -1.0]),
        "as said": np.eye(2),
    }[mounted]
    sweeps = drive(step_m=1.0)
    gatherer = Gatherer()
    for row in range(len(sweeps.world_T_sweep)):
        gatherer.add(np.asarray(sweeps.points(row)) @ robot_T_seen.T, sweeps.step(row))
    gathered = gatherer.gathered(5.0)
    fix = LevelFixer().fix(field, gathered)
    assert gathered.is_contradicted == (mounted != "as said")
    assert LevelFixer().is_misread(field, gathered, fix) == (mounted != "as said")
    gatherer.add(np.asarray(sweeps.points(0)), None)
    assert not gatherer.gathered(
        5.0
    ).is_contradicted  # another drive, which nothing contradicts yet


def test_gathered_sweeps_are_found_at_three_places_of_the_drive(field: Field) -> None:
    sweeps = drive(seed=5)
    rows = [12, 30, 45]
    gathered = sweeps.gathered(rows, 4.0)
    for row in rows:
        fix = LevelFixer().fix(field, gathered[row])
        assert OF_SWEEPS.right(
            fix.hypotheses[0].world_T_query[None], sweeps.world_T_sweep[row, None]
        )
        assert 2.0 < fix.path_m <= 4.0


def test_tracking_refines_the_guess_and_looks_for_no_other_pose(field: Field) -> None:
    place = PLACES[0]
    fix = LevelFixer().track(field, single(sweep(*place)), pose(4.2, 2.9, 0.35))
    (refined_guess,) = fix.hypotheses
    assert np.linalg.norm(refined_guess.world_T_query[:2, 3] - place[:2]) < 0.06


@pytest.mark.parametrize("points_m", [np.empty((0, 2)), np.full((99, 2), 200.0), np.ones((5, 2))])
def test_too_few_hits_make_no_pose(field: Field, points_m: np.ndarray) -> None:
    assert LevelFixer().fix(field, single(points_m)).hypotheses == ()
    assert LevelFixer().track(field, single(points_m), np.eye(4)).hypotheses == ()


def test_the_sweeps_of_another_building_fit_worse(field: Field) -> None:
    mirrored = tuple((y0, x0, y1, x1) for x0, y0, x1, y1 in WALLS)  # x and y exchanged
    fix = LevelFixer().fix(field, single(sweep(3.0, 4.0, 0.3, walls=mirrored)))
    true = LevelFixer().fix(field, single(sweep(4.0, 3.0, 0.3)))
    assert fix.hypotheses[0].quality < true.hypotheses[0].quality - 0.1
