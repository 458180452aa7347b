from datetime import date

import numpy as np
import pytest

from pipeline.frames import Trajectory, rpy
from pipeline.world.drive import Drive, drive
from pipeline.world.ground import Ground
from pipeline.world.odometry import integrate

FLAT = Ground(np.zeros((200, 40)), -100.0, -100.0)
STRAIGHT_M = np.array([[0.0, 0.0], [1300.0, 0.0]])


@pytest.fixture(scope="module")
def straight() -> Drive:
    return drive(0, date(2012, 1, 15), STRAIGHT_M, FLAT, 1200.0, 2.0)


def test_a_scan_is_taken_every_step(straight: Drive):
    assert len(straight.scan_rows) == 600
    places = straight.world_T_body[straight.scan_rows, :2, 3]
    assert np.hypot(*np.diff(places, axis=0).T) == pytest.approx(2.0, abs=0.05)
    # 2 m at 1.3 m/s
    assert np.diff(straight.utimes[straight.scan_rows]) == pytest.approx(2e6 / 1.3, abs=2)
    assert straight.metres == pytest.approx(599 * 2.0, rel=0.001)


def test_scans_lie_well_inside_the_truth(straight: Drive):
    assert straight.scan_rows[0] > 10
    assert straight.scan_rows[-1] < len(straight.utimes) - 10


def test_the_truth_is_interpolated_to_the_poses_of_the_scans(straight: Drive):
    truth = Trajectory(straight.utimes * 1000, straight.world_T_body, 1.0)
    poses, known = truth.at(straight.utimes[straight.scan_rows] * 1000)
    assert known.all()
    assert poses == pytest.approx(straight.world_T_body[straight.scan_rows], abs=1e-9)


def test_the_robot_rocks_like_a_segway_and_keeps_right(straight: Drive):
    roll, pitch, _ = np.rad2deg(rpy(straight.world_T_body)).T
    # About 1,200 m / 2 × 3 m = 200 independent draws: sds within 10 %.
    assert roll.std() == pytest.approx(1.2, rel=0.15)
    assert pitch.std() == pytest.approx(1.8, rel=0.15)
    assert max(np.abs(roll).max(), np.abs(pitch).max()) < 5.3
    aside_m = straight.world_T_body[:, 1, 3]
    assert np.abs(aside_m).max() <= 3.0
    assert 0.2 < aside_m.std() < 1.2
    means_m = [drive(seed, date(2012, 1, 15), STRAIGHT_M, FLAT, 1200.0, 2.0).world_T_body[:, 1, 3].mean() for seed in range(12)]
    # 0.8 m right of the middle, give or take a bias of 0.5 m / √12.
    assert np.mean(means_m) == pytest.approx(-0.8, abs=0.5)


def test_the_pilot_walks_behind(straight: Drive):
    body_T_world = np.linalg.inv(straight.world_T_body[straight.scan_rows])
    pilot = np.column_stack([straight.pilot_m, np.zeros(600), np.ones(600)])
    behind = np.einsum("nij,nj->ni", body_T_world, pilot)
    assert (behind[:, 0] < 0).mean() > 0.95
    assert np.hypot(*behind[:, :2].T).mean() == pytest.approx(1.7, abs=0.2)


def test_another_date_takes_another_line(straight: Drive):
    other = drive(0, date(2012, 2, 4), STRAIGHT_M, FLAT, 1200.0, 2.0)
    assert np.abs(other.world_T_body[other.scan_rows, 1, 3] - straight.world_T_body[straight.scan_rows, 1, 3]).mean() > 0.1


def test_odometry_starts_at_the_origin_and_drifts_a_few_per_cent(straight: Drive):
    drifted = integrate(np.random.default_rng(1), straight.world_T_body)
    assert drifted[0] == pytest.approx(np.eye(4), abs=1e-9)
    start_T_body = np.linalg.inv(straight.world_T_body[0]) @ straight.world_T_body
    errors_m = np.linalg.norm(drifted[:, :3, 3] - start_T_body[:, :3, 3], axis=1)
    # Over the first 13 m it is centimetres; over 1.2 km metres to tens of metres.
    assert errors_m[100] < 1.0
    assert 1.0 < errors_m[-1] < 400.0
