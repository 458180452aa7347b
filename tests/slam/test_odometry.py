"""Odometry: how a step is guessed, and how motion within a scan is corrected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import distance_and_turn, pose
from pipeline.core.progress import Progress
from pipeline.formats.bag import BagWriter
from pipeline.opening.opening import unposed
from pipeline.slam.odometry import ScanOdometry, turned_by
from tests.slam.round import STEP_NS, drive

UNHELPED = ScanOdometry(trials=1, usual=0.01, least=0.01)
"""Takes the step of the first guess, however low its overlap."""
START_NS = 1_700_000_000_000_000_000


def test_a_step_that_is_turned_bends_to_an_arc() -> None:
    """A metre straight on, and a quarter turn to the left: its end lies at 45°, √½ m to each."""
    straight_on = pose(np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))[0]
    bent = turned_by(straight_on, np.pi / 2)
    expected = pose(np.array([[0.5**0.5, 0.5**0.5, 0.0]]), np.array([[0.0, 0.0, np.pi / 2]]))[0]
    np.testing.assert_allclose(bent, expected, atol=1e-12)
    np.testing.assert_allclose(turned_by(bent, 0.0), straight_on, atol=1e-12)


def test_an_imu_guesses_a_turn_that_registration_alone_does_not_find(tmp_path: Path) -> None:
    """Two steps of a metre, then 60° to the left on the spot, in the half second between scans."""
    world_T_scan = turning_on_the_spot()
    log = drive(world_T_scan)
    with BagWriter(tmp_path / "monday", "mcap") as bag:
        for row in range(len(world_T_scan)):
            points_m = log.points(row).astype(np.float32)
            rings = np.zeros(len(points_m), int)
            bag.points(START_NS + row * STEP_NS, "lidar", points_m, np.ones(len(points_m)), rings)
        for reading in range(200):
            stamp_ns = START_NS + reading * STEP_NS // 50
            is_turning = 100 <= reading < 150  # from scan 2 to 3
            rate_rad_s = np.array([0.0, 0.0, np.deg2rad(120.0) * is_turning])
            bag.imu(stamp_ns, "lidar", rate_rad_s)
    opened = unposed(tmp_path / "monday")
    driven = np.linalg.inv(world_T_scan[0]) @ world_T_scan
    for version, is_found in ((opened, True), (replace(opened, heading_rad=None), False)):
        track = UNHELPED.along(version, Progress())
        turn_deg = distance_and_turn(track.odom_T_scan, driven)[1]
        assert (turn_deg[3] < 1.0) == is_found
    ignored = UNHELPED.along(opened, Progress(), use_log_odometry=False)
    assert distance_and_turn(ignored.odom_T_scan, driven)[1][3] > 1.0


def turning_on_the_spot() -> NDArray[np.float64]:
    """Four poses (4, 4, 4): two steps of a metre, then a turn of 60° on the spot."""
    x_m = np.array([0.0, 1.0, 2.0, 2.0])
    turn_rad = np.deg2rad([0.0, 0.0, 0.0, 60.0])
    zeros = np.zeros(4)
    return pose(
        np.column_stack([x_m, zeros - 10.0, zeros]), np.column_stack([zeros, zeros, turn_rad])
    )


def test_a_scan_is_deskewed_once_more_by_its_own_step() -> None:
    """The robot starts with 2 m/s, its scan takes the last quarter of a second before the stamp.

    On average its points lie .25 m too far ahead, and so does the pose that comes of them; deskewed
    by that step, of .75 m, a quarter of the error is left.
    """
    x_m = np.array([0.0, 1.0])
    log = drive(pose(np.column_stack([x_m, 0 * x_m - 10.0, 0 * x_m]), np.zeros((2, 3))))
    offsets_s = np.random.default_rng(0).uniform(-0.25, 0.0, len(log.points(1)))

    def skewed(row: int) -> NDArray[np.float64]:
        points_m = np.array(log.points(row))
        if row == 1:
            points_m[:, 0] -= 2.0 * offsets_s
        return points_m

    timed = replace(log, points=skewed, times_s=lambda row: offsets_s if row == 1 else None)
    off_m = []
    for version in (replace(timed, times_s=lambda row: None), timed):
        track = UNHELPED.along(version, Progress())
        off_m.append(abs(track.odom_T_scan[1, 0, 3] - 1.0))
    assert 0.15 < off_m[0] < 0.35
    assert off_m[1] < 0.1
