"""Belief: how fixes along a path speak for and against each other."""

import numpy as np
import pytest

from pipeline.paths.belief import JUMPS, Belief, still_right
from tests.posing.scene import planar


def test_at_first_a_chance_stays_what_it_is() -> None:
    for chance in (0.05, 0.5, 0.99):
        belief = Belief()
        assert belief.best() is None
        assert belief.see(planar(100, 0, 0), chance) == pytest.approx(chance)
        pose, known = belief.best()
        assert (pose[0, 3], known) == (100, pytest.approx(chance))


def test_fixes_that_agree_with_the_path_raise_the_chance_and_those_that_do_not_lower_it() -> None:
    agreed, jumped = Belief(), Belief()
    for belief in (agreed, jumped):
        assert belief.see(planar(100, 0, 0), 0.8) == pytest.approx(0.8)
        belief.move(planar(4, 0, 0))
    # There with 0.8 × (1 − JUMPS), and wrong poses agree by 0.3: right by 0.8 (0.2 + 0.8 / 0.3), wrong by 0.2 × 0.2.
    there = 0.8 * (1 - JUMPS)
    right = 0.8 * (1 - there + there / 0.3)
    assert agreed.see(planar(104, 0, 0), 0.8) == pytest.approx(right / (right + 0.2 * (1 - there)))
    # Elsewhere: right by 0.8 × 0.2, wrong by 0.2.
    assert jumped.see(planar(200, 0, 0), 0.8) == pytest.approx(0.8 * (1 - there) / (0.8 * (1 - there) + 0.2))


def test_a_tracked_pose_is_believed_by_its_own_chance_alone() -> None:
    better, worse = Belief(), Belief()
    before, _ = (belief.see(planar(100, 0, 0), 0.9) for belief in (better, worse))
    assert better.see(planar(100, 0, 0), 0.95, tracked=True) > before
    assert worse.see(planar(100, 0, 0), 0.3, tracked=True) < before - 0.3


def test_belief_is_carried_by_the_odometry_and_less_sure_with_every_metre() -> None:
    belief = Belief()
    belief.see(planar(50, 0, 0), 0.99)
    for step in (planar(8, 0, 0), planar(0, 0, 90), planar(2, 0, 0)):
        belief.move(step)
    pose, chance = belief.best()
    assert pose == pytest.approx(planar(58, 2, 90))
    assert chance == pytest.approx(0.99 * (1 - JUMPS) ** 3 * still_right(np.array(10.0)))


@pytest.mark.parametrize("guessed", [True, False], ids=["guessed", "by odometry"])
def test_to_agree_is_no_looser_than_to_be_right(guessed: bool) -> None:
    """A pose that slipped along the street by more than 2 m is for nothing that is believed, however far the robot drifted."""
    for off_m, agrees in ((1.9, True), (2.1, False), (3.5, False), (7.9, False)):
        belief = Belief()
        belief.see(planar(0, 0, 0), 0.99)
        belief.move(planar(0, 0, 0) if guessed else planar(40, 0, 0), guessed)
        pose = belief.best()[0]
        slipped = pose @ planar(off_m, 0, 0)
        assert (belief.see(slipped, 0.56) > 0.56) == agrees


def test_what_may_have_drifted_allows_a_right_pose_beside_it() -> None:
    # After 40 m of 5 % the robot is within 2 m of where it should be by erf(2 / (√2 × 2)) = .6827: the rest is beside it.
    near, far = Belief(), Belief()
    for belief in (near, far):
        belief.see(planar(0, 0, 0), 0.99)
        belief.move(planar(40, 0, 0))
    there = 0.99 * (1 - JUMPS)
    allowed = (1 - there) + there * (1 - 0.6827)
    right = 0.9 * allowed
    assert near.see(planar(43.5, 0, 0), 0.9) == pytest.approx(right / (right + 0.1 * (there + 1 - there)), abs=1e-4)
    assert far.see(planar(60, 0, 0), 0.9) < 0.2  # three deviations are 6 m: beyond it no drift explains the pose


def test_a_guessed_step_leaves_less_of_what_was_known() -> None:
    # A pose that was only guessed from keeps erf(2 / (√2 × 2 m)) = .68 of its chance.
    belief = Belief()
    belief.see(planar(0, 0, 0), 0.9)
    belief.move(np.eye(4), guessed=True)
    assert belief.best()[1] == pytest.approx(0.9 * (1 - JUMPS) * 0.6827, abs=1e-4)


def test_a_carried_robot_is_found_again_by_poses_that_agree() -> None:
    belief = Belief()
    chances = []
    for x_m in (*[0] * 20, *[300] * 8):
        belief.move(planar(0, 0, 0))
        chances.append(belief.see(planar(x_m, 0, 0), 0.9))
    assert chances[19] > 0.99
    assert chances[20] < 0.1
    assert chances[-1] > 0.99
    assert belief.chances.sum() <= 1 + 1e-9


def test_the_chance_to_be_right_after_a_way() -> None:
    # 5 % of 20 m is 1 m: within 2 m in .9545 of all cases.
    assert still_right(np.array([0.0, 20.0])) == pytest.approx([1.0, 0.9545], abs=1e-4)
