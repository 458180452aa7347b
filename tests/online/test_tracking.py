"""A tracker tracks a robot along its path, predicts its motion, and finds it again when lost."""

from copy import copy
from pathlib import Path

import numpy as np
import pytest

from pipeline.online.motion import Motion
from pipeline.online.site import NO_THRESHOLDS, Site
from pipeline.online.tracking import PATIENCE, Tracker
from pipeline.posing.fix import ScanFix as Registered
from tests.online.made import ANCHORS
from tests.posing.scene import hypothesis, planar, scene, seen_from


@pytest.fixture(scope="module")
def site(three_places: Path) -> Site:
    return Site.open(three_places)


def seen(row: int, x_m: float) -> np.ndarray:
    """Points (n, 3) seen from `x_m` along x in place `row`."""
    return seen_from(scene(row), planar(x_m, 0, 0))


def test_a_path_is_followed_with_and_without_odometry(site: Site) -> None:
    for step in (planar(0.5, 0, 0), None):
        tracker = Tracker(site)
        assert tracker.mode == "lost"
        for i in range(4):
            fix = tracker.localize(seen(0, 0.5 * i), step)
            assert (fix.verdict, tracker.mode) == ("accepted", "tracking")
            np.testing.assert_allclose(
                fix.world_T_sensor, ANCHORS[0] @ planar(0.5 * i, 0, 0), atol=0.1
            )


def test_without_odometry_a_robot_moves_on_for_as_long_as_the_stamps_say(site: Site) -> None:
    tracker = Tracker(site)
    for i, stamp_s in ((0, 0), (2, 1)):  # a metre in a second
        tracker.localize(seen(0, 0.5 * i), None, stamp_s * 10**9)
    # 3 m farther on after three seconds: from its last pose it would not be found
    fix = tracker.localize(seen(0, 4.0), None, 4 * 10**9)
    assert (fix.verdict, tracker.mode) == ("accepted", "tracking")
    np.testing.assert_allclose(fix.world_T_sensor, ANCHORS[0] @ planar(4, 0, 0), atol=0.1)


SECOND = 10**9
STAMPS = {
    "one stamp twice": [0, 1, 2, 2, 4, 5],
    "a clock set back by 100 s": [0, 1, 2, -97, -96, -95],
    "a stamp of 0": [1000, 1001, 1002, 0, 1004, 1005],
    "a millisecond after the last": [0, 1, 2, 2.001, 4, 5],
    "a pause of a minute": [0, 1, 2, 62, 63, 64],
}
"""Stamps in seconds of six scans, half a metre and a second apart, by a clock with a fault at the
fourth."""


@pytest.mark.parametrize("stamps_s", STAMPS.values(), ids=STAMPS)
def test_a_faulty_clock_does_not_predict_a_robot_farther_than_it_can_drive(
    site: Site, stamps_s: list[float]
) -> None:
    motion = Motion()
    for i, stamp_s in enumerate(stamps_s):
        if i:
            predicted = motion.predict(stamp_s - stamps_s[i - 1])
            assert np.linalg.norm(predicted[:3, 3] - (0.5 if i > 1 else 0.0, 0, 0)) < 1.0
        motion.note_fix(planar(0.5 * i, 0, 0), stamp_s)
    tracker = Tracker(site)
    verdicts = [
        tracker.localize(seen(0, 0.5 * i), None, round(at * SECOND)).verdict
        for i, at in enumerate(stamps_s)
    ]
    assert verdicts == ["accepted"] * 6


def test_fixes_that_no_robot_can_drive_tell_no_speed() -> None:
    motion = Motion()
    # 1 m/s, then 100 m/s, then 10 m/s within a millisecond
    for x_m, time_s in ((0, 0), (1, 1), (101, 2), (101.01, 2.001)):
        motion.note_fix(planar(x_m, 0, 0), time_s)
    np.testing.assert_allclose(motion.predict(2.0), planar(2, 0, 0))
    np.testing.assert_allclose(motion.predict(0.0), np.eye(4))


def test_after_a_long_pause_a_robot_without_odometry_is_sought_everywhere(site: Site) -> None:
    tracker = Tracker(site)
    for i in range(3):
        tracker.localize(seen(0, 0.5 * i), None, i * SECOND)
    alone = Tracker(site).localize(seen(2, 0.0), None, 60 * SECOND)
    fixes = [tracker.localize(seen(2, 0.5 * i), None, (60 + i) * SECOND) for i in range(4)]
    poses = np.array([fix.world_T_sensor for fix in fixes])
    # the belief before the pause changes nothing
    assert fixes[0].novelty == pytest.approx(alone.novelty)
    assert (np.linalg.norm(poses[:, :2, 3] - ANCHORS[2, :2, 3], axis=1) < 10).all()
    assert fixes[-1].verdict == "accepted"


def test_odometry_that_was_set_back_does_not_carry_a_robot_off(site: Site) -> None:
    """At .5 m/s, odometry once jumps back by 90 m: no robot drives so far, so the step is
    guessed."""
    tracker = Tracker(site)
    for i in range(6):
        step = planar(-90 if i == 4 else 0.5, 0, 0)
        fix = tracker.localize(seen(0, 0.5 * i), step, i * SECOND)
        assert (fix.verdict, tracker.mode) == ("accepted", "tracking")
        np.testing.assert_allclose(fix.world_T_sensor, ANCHORS[0] @ planar(0.5 * i, 0, 0), atol=0.1)


def test_a_robot_that_is_carried_off_is_sought_everywhere_at_once(site: Site) -> None:
    """Its first scan elsewhere does not fit where it is believed to be."""
    tracker = Tracker(site)
    for i in range(3):
        tracker.localize(seen(0, 0.5 * i), planar(0.5, 0, 0))
    for i in range(4):
        fix = tracker.localize(seen(2, 0.5 * i), planar(0.5, 0, 0))
        away_m = np.linalg.norm(fix.world_T_sensor[:2, 3] - ANCHORS[2, :2, 3])
        assert away_m < 10
    assert (fix.verdict, tracker.mode) == ("accepted", "tracking")


def test_a_robot_is_lost_after_scans_that_fit_nowhere(site: Site) -> None:
    tracker = Tracker(site)
    for i in range(3):
        tracker.localize(seen(0, 0.5 * i), planar(0.5, 0, 0))
    rng = np.random.default_rng(0)
    modes = []
    for _ in range(PATIENCE):
        nothing = rng.uniform(-20, 20, (3000, 3))
        assert tracker.localize(nothing, planar(0.5, 0, 0)).verdict != "accepted"
        modes.append(tracker.mode)
    assert modes == ["tracking"] * (PATIENCE - 1) + ["lost"]
    assert tracker.belief.best() is None


def test_a_track_starts_only_from_a_fix_that_its_own_scan_accepts(site: Site) -> None:
    """The belief is no substitute, however certain, neither at the start nor while the robot
    stands."""
    unsure = copy(site)
    unsure.target_precisions = dict.fromkeys(
        site.target_precisions, NO_THRESHOLDS
    )  # no scan alone is accepted
    tracker = Tracker(unsure)
    fixes = [tracker.localize(seen(0, 0.5 * i), planar(0.5, 0, 0)) for i in range(6)]
    assert fixes[-1].probability > 0.999
    assert {(fix.verdict, fix.accepted_at) for fix in fixes} == {("rejected", None)}
    tracker.site = site
    assert tracker.localize(seen(0, 3.0), planar(0.5, 0, 0)).verdict == "accepted"
    tracker.site = unsure
    assert tracker.localize(seen(0, 3.0), np.eye(4)).verdict == "rejected"
    assert tracker.localize(seen(0, 3.5), planar(0.5, 0, 0)).verdict == "accepted"


def test_a_tracked_pose_is_never_called_near(site: Site) -> None:
    """At an overlap of .5 a pose is near if the whole map was searched for others, else
    rejected."""
    found = Registered.of([hypothesis(0, 0.5)], site.claim_judge.pose)
    fix = site.judge(found, 0.99)
    assert Tracker(site)._judged_along_path(fix, is_tracked=False).verdict == "near"
    assert Tracker(site)._judged_along_path(fix, is_tracked=True).verdict == "rejected"
