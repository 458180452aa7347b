"""Belief: how fixes along a path raise and lower each other's probabilities."""

import numpy as np
import pytest

from pipeline.paths.belief import JUMP_PROBABILITY, Belief, still_right
from tests.posing.scene import planar


def drive_to_origin(belief: Belief) -> None:
    """Four fixes with a probability of .99, a metre apart: the pose becomes certain."""
    for x_m in (-3, -2, -1, 0):
        belief.move(planar(1, 0, 0))
        belief.see(planar(x_m, 0, 0), 0.99)


def test_the_first_fix_has_the_probability_of_its_scan() -> None:
    for probability in (0.05, 0.5, 0.99):
        belief = Belief()
        assert belief.best() is None
        assert belief.see(planar(100, 0, 0), probability) == pytest.approx(probability)
        pose, best_probability = belief.best()
        assert pose[0, 3] == 100
        assert best_probability == pytest.approx(probability)


def test_fixes_that_agree_with_the_path_raise_the_probability_and_those_that_do_not_lower_it() -> (
    None
):
    agreed = Belief()
    jumped = Belief()
    for belief in (agreed, jumped):
        assert belief.see(planar(100, 0, 0), 0.8) == pytest.approx(0.8)
        belief.move(planar(4, 0, 0))
    # The robot is at the first fix with 0.8 × (1 − JUMP_PROBABILITY), and a wrong fix lies there
    # with 0.3. So a fix there is right with a weight of 0.8 (0.2 + 0.8 / 0.3), wrong with one of
    # 0.2 × 0.2.
    at_first = 0.8 * (1 - JUMP_PROBABILITY)
    elsewhere = 1 - at_first
    right = 0.8 * (elsewhere + at_first / 0.3)
    wrong = 0.2 * elsewhere
    assert agreed.see(planar(104, 0, 0), 0.8) == pytest.approx(right / (right + wrong))
    # A fix elsewhere is right with a weight of 0.8 × 0.2, wrong with one of 0.2.
    right = 0.8 * elsewhere
    assert jumped.see(planar(200, 0, 0), 0.8) == pytest.approx(right / (right + 0.2))


def test_a_tracked_pose_counts_by_its_own_probability_alone() -> None:
    better = Belief()
    worse = Belief()
    before, _ = (belief.see(planar(100, 0, 0), 0.9) for belief in (better, worse))
    assert better.see(planar(100, 0, 0), 0.95, tracked=True) > before
    assert worse.see(planar(100, 0, 0), 0.3, tracked=True) < before - 0.3


def test_belief_is_carried_by_the_odometry_and_less_sure_with_every_metre() -> None:
    belief = Belief()
    belief.see(planar(50, 0, 0), 0.99)
    for step in (planar(8, 0, 0), planar(0, 0, 90), planar(2, 0, 0)):
        belief.move(step)
    pose, probability = belief.best()
    assert pose == pytest.approx(planar(58, 2, 90))
    drift_m = np.array(0.5)  # 5 % of 10 m
    assert probability == pytest.approx(0.99 * (1 - JUMP_PROBABILITY) ** 3 * still_right(drift_m))


def test_a_pose_within_the_drift_agrees_and_one_beyond_it_does_not() -> None:
    for off_m, agrees in ((4.9, True), (5.1, False)):  # 2 m, and three times 5 % of 20 m
        belief = Belief()
        belief.see(planar(0, 0, 0), 0.9)
        belief.move(planar(20, 0, 0))
        assert (belief.see(planar(20, off_m, 0), 0.9) > 0.9) == agrees


def test_after_a_guessed_step_a_fix_agrees_within_the_deviations_of_the_guess() -> None:
    # It agrees within 2 m and three times 2 m. The pose that was moved by the guess keeps
    # erf(2 m / (√2 × 2 m)) = .68 of its probability.
    for off_m, near in ((7.9, True), (8.1, False)):
        belief = Belief()
        belief.see(planar(0, 0, 0), 0.9)
        belief.move(np.eye(4), deviations=(2.0, 4.0))
        assert belief.best()[1] == pytest.approx(0.9 * (1 - JUMP_PROBABILITY) * 0.6827, abs=1e-4)
        assert (belief.see(planar(off_m, 0, 0), 0.9) > 0.9) == near


@pytest.mark.parametrize("tracked", [False, True])
def test_a_pose_that_slipped_from_a_guess_is_no_more_probable_than_alone(tracked: bool) -> None:
    """A fix 3.5 m along the street from a hypothesis is not near enough to be right with it.

    By hand, if it was not tracked: the hypothesis has a probability of .999 and lies near, so the
    fix is right with a weight of .56 × .999 / .3, and has slipped with one of .44 × .999: .81.
    """
    belief = Belief()
    drive_to_origin(belief)
    belief.move(np.eye(4), deviations=(2.0, 4.0))
    probability = belief.see(planar(3.5, 0, 0), 0.56, tracked)
    assert probability < 0.9
    assert tracked or probability == pytest.approx(0.81, abs=0.01)


def test_a_pose_that_may_have_slipped_is_off_by_as_much() -> None:
    """A fix is 3.5 m along x from a hypothesis of .19 that has drifted by 2 m.

    So its covariance is .19 (3.5² + 2²) m² along x, and .19 · 2² m² across.
    """
    belief = Belief()
    drive_to_origin(belief)
    belief.move(np.eye(4), deviations=(2.0, 4.0))
    wrong = 1 - belief.see(planar(3.5, 0, 0), 0.56)
    moment_m2 = belief.slipped_m2()
    assert np.diag(moment_m2) == pytest.approx(wrong * np.array([3.5**2 + 4, 4, 4]), rel=0.01)
    sure = Belief()
    drive_to_origin(sure)
    assert not sure.slipped_m2().any()


def test_a_pose_beside_a_sure_guess_becomes_more_probable() -> None:
    belief = Belief()
    drive_to_origin(belief)
    belief.move(planar(5, 0, 0), deviations=(0.1, 1.0))
    assert belief.see(planar(5.1, 0, 0), 0.8, tracked=True) > 0.99


def test_a_pose_beside_a_guess_may_be_turned_as_far_as_the_guess() -> None:
    for turn_deg, near in ((16, True), (18, False)):  # 5°, and three times 4°
        belief = Belief()
        belief.see(planar(0, 0, 0), 0.9)
        belief.move(planar(1, 0, 0), deviations=(2.0, 4.0))
        assert (belief.see(planar(1, 0, turn_deg), 0.9) > 0.9) == near


def test_a_carried_robot_is_found_again_by_poses_that_agree() -> None:
    belief = Belief()
    probabilities = []
    for x_m in (*range(20), *range(300, 308)):
        belief.move(planar(1, 0, 0))
        probabilities.append(belief.see(planar(x_m, 0, 0), 0.9))
    assert probabilities[19] > 0.99
    assert probabilities[20] < 0.1
    assert probabilities[-1] > 0.99
    assert belief.now.probabilities.sum() <= 1 + 1e-9


def test_the_same_view_without_motion_is_no_new_evidence() -> None:
    """Twenty sweeps of a robot that stands, or rocks by .3 m, leave the probability of the newest
    one."""
    for step in (planar(0, 0, 0), planar(0.3, 0, 0)):
        belief = Belief()
        for _ in range(10):
            for there in (step, np.linalg.inv(step)):
                belief.move(there)
                assert belief.see(planar(100, 0, 0), 0.565) == pytest.approx(0.565)
        assert belief.see(planar(100, 0, 0), 0.9) == pytest.approx(0.9)
        assert belief.views == 1


def test_without_odometry_fixes_tell_whether_the_robot_has_moved() -> None:
    standing = Belief()
    moving = Belief()
    for number in range(4):
        for belief, x_m in ((standing, 0.1 * number), (moving, 1.0 * number)):
            belief.move(np.eye(4), deviations=(1.0, 1.0))
            belief.see(planar(x_m, 0, 0), 0.6)
    assert (standing.views, moving.views) == (1, 4)
    assert standing.best()[1] == pytest.approx(0.6)
    assert moving.best()[1] > 0.9


def test_a_path_is_not_forgotten_while_the_robot_stands() -> None:
    """Nor do views of one place that contradict each other add up."""
    belief = Belief()
    drive_to_origin(belief)
    for _ in range(2000):
        belief.move(np.eye(4))
    assert belief.see(planar(0, 0, 0), 0.9) > 0.999
    assert belief.see(planar(50, 0, 0), 0.9) < 0.1
    belief.move(planar(1, 0, 0))
    assert belief.see(planar(1, 0, 0), 0.9) > 0.999


def test_the_probability_to_be_right_after_a_drift() -> None:
    # A pose is right within 2 m: two deviations of 1 m, which .9545 of all cases are within.
    assert still_right(np.array([0.0, 1.0])) == pytest.approx([1.0, 0.9545], abs=1e-4)


def test_a_level_pose_agrees_within_a_metre_and_ten_degrees() -> None:
    for pose, agrees in (
        (planar(0.9, 0, 8), True),
        (planar(1.1, 0, 0), False),
        (planar(0, 0, 12), False),
    ):
        belief = Belief(right_within=(1.0, 10.0))
        belief.see(planar(0, 0, 0), 0.9)
        belief.move(planar(0, 0.6, 0))  # drifts by 9 cm and .2° at most, of which 1 m is short
        probability = belief.see(planar(0, 0.6, 0) @ pose, 0.9)
        assert (probability > 0.9) == agrees


def test_gathered_scans_that_overlap_are_one_view() -> None:
    """Sweeps are gathered over 5 m: of fixes a metre apart every fifth is a view of its own."""
    belief = Belief(new_view_m=5.0)
    probabilities = []
    for x_m in range(11):
        probabilities.append(belief.see(planar(x_m, 0, 0), 0.7))
        belief.move(planar(1, 0, 0))
    assert belief.views == 3
    assert probabilities[:5] == pytest.approx([0.7] * 5)
    assert probabilities[5] > 0.85
    assert probabilities[5:10] == pytest.approx([probabilities[5]] * 5, abs=0.01)


def test_a_track_starts_where_a_scan_alone_is_accepted_and_ends_where_fixes_disagree() -> None:
    belief = Belief()
    started_at = []
    for x_m, accepted_at in ((0, 0.0), (1, 0.95), (2, 0.0), (3, 0.99), (4, 0.0), (300, 0.0)):
        belief.see(planar(x_m, 0, 0), 0.9, accepted_at=accepted_at)
        started_at.append(belief.started_at)
        belief.move(planar(1, 0, 0))
    assert started_at == [0.0, 0.95, 0.95, 0.99, 0.99, 0.0]


def test_the_view_that_was_accepted_starts_no_track_for_the_same_view() -> None:
    belief = Belief()
    for accepted_at, started_at in ((0.99, 0.99), (0.0, 0.0)):
        belief.see(planar(0, 0, 0), 0.9, accepted_at=accepted_at)
        belief.move(planar(0.1, 0, 0))
        assert belief.started_at == started_at
