"""Tests of calibration: which scans have a reference pose, and which are one block."""

import numpy as np

from pipeline.lifelong.calibration import between_others, blocks
from pipeline.online.inputs import NO_POSE
from tests.posing.scene import planar

ODOMETRY = np.array([planar(x, 0, 0) for x in (0.0, 2.0, 4.0, 6.0)])


def test_a_scan_is_confirmed_by_the_fixes_around_it_not_by_its_own() -> None:
    """The fix at 4 m is 30 m off; the path from 2 m to 6 m says 4 m. The first and the last scan
    have no fix on both sides, and those beside the wrong fix are not confirmed by it."""
    poses = np.array([planar(0, 0, 0), planar(2, 0, 0), planar(34, 0, 0), planar(6, 0, 0)])
    between = between_others(poses, ODOMETRY)
    assert np.isnan(between[[0, 1, 3]]).all()
    np.testing.assert_allclose(between[2], planar(4, 0, 0), atol=1e-9)


def test_a_scan_without_a_fix_is_confirmed_too() -> None:
    poses = np.array([planar(0, 0, 0), NO_POSE, NO_POSE, planar(6, 0, 0)])
    np.testing.assert_allclose(between_others(poses, ODOMETRY)[1:3], ODOMETRY[1:3], atol=1e-9)


def test_fixes_many_scans_apart_confirm_nothing() -> None:
    odometry = np.array([planar(x, 0, 0) for x in np.arange(30.0)])
    poses = odometry.copy()
    poses[1:29] = NO_POSE
    assert np.isnan(between_others(poses, odometry)).all()


def test_odometry_that_is_interrupted_confirms_nothing() -> None:
    odometry = ODOMETRY.copy()
    odometry[1] = NO_POSE
    assert np.isnan(between_others(ODOMETRY, odometry)[1]).all()


def test_scans_within_five_metres_are_one_block() -> None:
    """Blocks begin at 0 m and at 6 m; the scan at 10 m is 4 m from the second beginning."""
    xy_m = np.array([(0.0, 0), (3, 0), (6, 0), (10, 0), (11, 0)])
    assert blocks(xy_m).tolist() == [0, 0, 1, 1, 2]


def test_a_second_round_is_no_further_block() -> None:
    """Back along the same way, 1 m beside it; 20 m is a block of its own."""
    xy_m = np.array([(0.0, 0), (6, 0), (12, 0), (12, 1), (6, 1), (0, 1), (0, 20)])
    assert blocks(xy_m).tolist() == [0, 1, 2, 2, 1, 0, 3]
