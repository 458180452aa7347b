"""Drives of a Segway and of a car: their scans, rocking, offsets, slopes and pilot."""

from datetime import UTC, date, datetime

import numpy as np
import pytest

from pipeline.core.frames import Trajectory, rpy
from tests.worlds.helpers import FLAT
from worlds.driving.drive import CAR, SEGWAY, Drive, Motion, drive
from worlds.layout.ground import Ground

STRAIGHT_M = np.array([[0.0, 0.0], [1300.0, 0.0]])


def driven(
    seed: int = 0,
    when: date = date(2012, 1, 15),
    motion: Motion = SEGWAY,
    route_m: float = 1200.0,
    step_m: float = 2.0,
    ground: Ground = FLAT,
    lateral_m: float = 0.0,
) -> Drive:
    """A drive straight ahead."""
    return drive(seed, when, STRAIGHT_M, ground, route_m, step_m, motion, lateral_m)


@pytest.fixture(scope="module")
def straight() -> Drive:
    return driven()


def test_a_scan_is_taken_every_step_well_inside_the_ground_truth(straight: Drive):
    assert len(straight.scan_rows) == 600
    places = straight.world_T_body[straight.scan_rows, :2, 3]
    assert np.hypot(*np.diff(places, axis=0).T) == pytest.approx(2.0, abs=0.05)
    # 2 m at 1.3 m/s
    assert np.diff(straight.scan_utimes) == pytest.approx(2e6 / 1.3, abs=2)
    assert straight.length_m == pytest.approx(599 * 2.0, rel=0.001)
    assert straight.scan_rows[0] > 10
    assert straight.scan_rows[-1] < len(straight.utimes) - 10


def test_the_ground_truth_is_interpolated_to_the_poses_of_the_scans_and_known_at_any_moment(
    straight: Drive,
):
    ground_truth = Trajectory(straight.utimes * 1000, straight.world_T_body, 1.0)
    poses, known = ground_truth.at(straight.scan_utimes * 1000)
    assert known.all()
    assert poses == pytest.approx(straight.world_T_body[straight.scan_rows], abs=1e-9)
    rows = np.array([100, 101])
    middle = straight.at(straight.utimes[rows].mean(keepdims=True).astype(int))
    assert middle[0, :3, 3] == pytest.approx(straight.world_T_body[rows, :3, 3].mean(0), abs=1e-4)


def test_the_robot_rocks_like_a_segway_and_keeps_right(straight: Drive):
    roll, pitch, _ = np.rad2deg(rpy(straight.world_T_body)).T
    # About 1,200 m / 2 × 3 m = 200 independent draws: sds within 10 %.
    assert roll.std() == pytest.approx(1.2, rel=0.15)
    assert pitch.std() == pytest.approx(1.8, rel=0.15)
    assert max(np.abs(roll).max(), np.abs(pitch).max()) < 5.3
    aside_m = straight.world_T_body[:, 1, 3]
    assert np.abs(aside_m).max() <= 3.0
    assert 0.2 < aside_m.std() < 1.2
    # 0.8 m right of the middle, give or take a bias of 0.5 m / √12.
    assert np.mean(
        [driven(seed).world_T_body[:, 1, 3].mean() for seed in range(12)]
    ) == pytest.approx(-0.8, abs=0.5)


def test_the_pilot_walks_behind(straight: Drive):
    body_T_world = np.linalg.inv(straight.world_T_body[straight.scan_rows])
    pilot = np.column_stack([straight.pilot_m, np.zeros(600), np.ones(600)])
    behind = np.einsum("nij,nj->ni", body_T_world, pilot)
    assert (behind[:, 0] < 0).mean() > 0.95
    assert np.hypot(*behind[:, :2].T).mean() == pytest.approx(1.7, abs=0.2)


def test_another_date_or_time_takes_another_line(straight: Drive):
    other = driven(when=date(2012, 2, 4))
    assert (
        np.abs(
            other.world_T_body[other.scan_rows, 1, 3]
            - straight.world_T_body[straight.scan_rows, 1, 3]
        ).mean()
        > 0.1
    )
    morning, later = (
        driven(0, datetime(2014, 7, 14, hour, 16, 36, tzinfo=UTC), CAR, 100.0).world_T_body
        for hour in (14, 15)
    )
    assert np.abs(morning[:, 1, 3] - later[:, 1, 3]).mean() > 0.01


def test_a_car_keeps_right_at_eight_metres_a_second():
    cars = [driven(seed, date(2014, 7, 14), CAR, step_m=0.2) for seed in range(6)]
    assert len(cars[0].scan_rows) == 6000
    # 0.2 m at 8 m/s
    assert np.diff(cars[0].scan_utimes).tolist() == [25_000] * 5999
    roll, pitch, _ = np.rad2deg(rpy(cars[0].world_T_body)).T
    assert (roll.std(), pitch.std()) == pytest.approx((0.4, 0.5), rel=0.2)
    # 1.7 m right of the middle, give or take a bias of 0.15 m / √6; 1200 m / 2 × 25 m = 24 draws of
    # 0.25 m a drive.
    aside_m = np.array([car.world_T_body[:, 1, 3] for car in cars])
    assert aside_m.mean() == pytest.approx(-1.7, abs=0.2)
    assert 0.1 < aside_m[0].std() < 0.4
    assert cars[0].pilot_m is None


def test_a_car_stands_on_the_slope_that_it_climbs():
    # 4 m up over 100 m to the east, 2 m up over 100 m to the north: atan 0.04 = 2.29° nose up, atan
    # 0.02 = 1.15° left side up.
    hill = Ground(0.32 * np.arange(200)[:, None] + 0.16 * np.arange(40)[None, :], -100.0, -100.0)
    car, segway = (driven(0, date(2014, 7, 14), motion, ground=hill) for motion in (CAR, SEGWAY))
    roll, pitch, _ = np.rad2deg(rpy(car.world_T_body)).T
    assert (roll.mean(), pitch.mean()) == pytest.approx((1.15, -2.29), abs=0.15)
    assert np.abs(np.rad2deg(rpy(segway.world_T_body))[:, :2].mean(0)).max() < 0.5


def test_a_drive_departs_when_its_name_says():
    at_nine = driven(0, datetime(2014, 11, 25, 9, 18, 32, tzinfo=UTC), CAR, 100.0)
    # 25 November 2014, 9:18:32 UTC
    assert at_nine.utimes[0] == 1_416_907_112_000_000


@pytest.mark.parametrize("lateral_m", [2.0, -1.0])
def test_a_lateral_offset_moves_the_whole_drive_and_no_more(lateral_m: float):
    usual, aside = (
        driven(0, date(2012, 7, 14), route_m=400.0, lateral_m=offset_m)
        for offset_m in (0.0, lateral_m)
    )
    usual_m = usual.world_T_body[usual.scan_rows, 1, 3]
    aside_m = aside.world_T_body[aside.scan_rows, 1, 3]
    # The street's 3 m to either side cut a few of the weave's swings, and no more.
    assert np.median(aside_m - usual_m) == pytest.approx(lateral_m, abs=0.1)
    assert np.abs(aside_m).max() <= 3.0
