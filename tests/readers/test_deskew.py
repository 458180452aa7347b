"""Tests deskewing: points are moved to where they lay at the stamp of their scan."""

from collections import Counter
from dataclasses import replace

import numpy as np

from pipeline.core.frames import pose
from pipeline.readers.deskew import deskewed, scan_at_stamp
from pipeline.readers.log import Log


def test_a_point_is_moved_as_far_as_the_vehicle_drove_since_the_stamp() -> None:
    """At 10 m/s a point seen .05 s after the stamp, 3 m ahead, lies 3.5 m ahead of the stamp's."""
    step = pose(np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))[0]  # in .1 s
    points_m = np.array([[3.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    times_s = np.array([-0.05, 0.0, 0.05])
    moved_m = deskewed(points_m, times_s, step, 0.1)
    # slices of .1 s / 64 at 10 m/s are 1.6 cm, a point lies within half of one
    np.testing.assert_allclose(moved_m[:, 0], [2.5, 3.0, 3.5], atol=0.009)


def test_a_turning_vehicle_turns_the_points_back() -> None:
    """90° to the left in 1 s: a point straight ahead after .5 s lies 45° to the left at first."""
    step = pose(np.zeros((1, 3)), np.array([[0.0, 0.0, np.pi / 2]]))[0]
    moved_m = deskewed(np.array([[1.0, 0, 0], [1.0, 0, 0]]), np.array([0.0, 0.5]), step, 1.0)
    np.testing.assert_allclose(moved_m[1, :2], np.sqrt([0.5, 0.5]), atol=0.01)


def test_without_times_or_motion_points_stay() -> None:
    points_m = np.array([[3.0, 1.0, 0.0]])
    times_s = np.array([0.05])
    step = pose(np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))[0]
    for moved_m in (
        deskewed(points_m, None, step, 0.1),
        deskewed(points_m, times_s, step, 0.0),
        deskewed(points_m, times_s, np.full((4, 4), np.nan), 0.1),
    ):
        np.testing.assert_array_equal(moved_m, points_m)


def test_a_scan_is_deskewed_by_the_steps_before_and_after_it() -> None:
    """The vehicle comes with 5 m/s and goes on with 10 m/s.

    So a point .05 s before the stamp is moved .25 m back, one .05 s after it .5 m ahead. After a
    break, and at the end of the log, only one of the two steps is known, and is used for both.
    """
    x_m = np.array([0.0, 0.5, 1.5])
    log = Log(
        np.array([0, 1, 2]) * 10**8,
        np.full((3, 4, 4), np.nan),
        np.full((3, 4, 4), np.nan),
        lambda row: np.array([[3.0, 0.0, 0.0], [3.0, 0.0, 0.0]]),
        Counter(),
        times_s=lambda row: np.array([-0.05, 0.05]),
    )
    poses = pose(np.column_stack([x_m, 0 * x_m, 0 * x_m]), np.zeros((3, 3)))
    no_breaks = np.empty(0, np.int64)
    for row, breaks, expected in (
        (1, no_breaks, [2.75, 3.5]),
        (1, np.array([1]), [2.5, 3.5]),
        (2, no_breaks, [2.5, 3.5]),
        (2, np.array([2]), [3.0, 3.0]),
    ):
        points_m = scan_at_stamp(log, poses, breaks, row)
        np.testing.assert_allclose(points_m[:, 0], expected, atol=0.02)
    cached_m = np.array([[3.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    scan_at_stamp(replace(log, points=lambda row: cached_m), poses, no_breaks, 1)
    np.testing.assert_array_equal(cached_m, log.points(1))  # an array that a log keeps is unchanged
    timeless = replace(log, times_s=lambda row: None)
    np.testing.assert_array_equal(scan_at_stamp(timeless, poses, no_breaks, 1), log.points(1))
