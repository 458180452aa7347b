"""Turned: robots that are turned on the spot, and what they then see."""

import math

import numpy as np
import pytest

from pipeline.core.frames import pose
from pipeline.perturbations.turned import Turned, turned
from pipeline.views.scan_context import ScanContext
from tests.perturbations.made import perturbed

POINTS_M = np.random.default_rng(5).uniform((-60, -60, 0), (60, 60, 12), (3000, 3))


def drawn(perturbation: Turned, stamp_ns: int = 7) -> list[float]:
    """The angle of each case in radians."""
    return [left_rad for _, left_rad in perturbed(perturbation, POINTS_M, stamp_ns)]


def test_what_was_ahead_is_to_the_right_of_a_robot_that_turned_left() -> None:
    ahead = np.array([[4.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned(ahead, math.pi / 2), [[0, -4, 1]], atol=1e-12)
    assert ahead.tolist() == [[4.0, 0.0, 1.0]]


def test_a_turned_robots_points_lie_where_they_lay_in_the_world() -> None:
    _, (turned_points, left_rad) = perturbed(Turned(repeats=1), POINTS_M)
    world_T_anchor = pose(np.array([[30.0, -20.0, 1.0]]), np.array([[0.02, -0.03, 2.0]]))[0]
    world_T_turned = world_T_anchor @ pose(np.zeros((1, 3)), np.array([[0, 0, left_rad]]))[0]
    assert np.abs(turned_points - POINTS_M).max() > 1
    driven, turned = (
        points @ a_T_b[:3, :3].T + a_T_b[:3, 3]
        for a_T_b, points in ((world_T_anchor, POINTS_M), (world_T_turned, turned_points))
    )
    np.testing.assert_allclose(turned, driven, atol=1e-9)


@pytest.mark.parametrize("sectors", [1, 40, 113])
def test_a_turn_by_whole_sectors_rolls_the_scan_context(sectors: int) -> None:
    """What was in sector k, which is 3° wide, comes to sector k − turned.

    Points are not averaged, since the cubes in which that is done do not turn.
    """
    view = ScanContext(voxel_m=0.0, min_points=1)
    driven = view(POINTS_M)
    assert (driven > 0).mean() > 0.2
    np.testing.assert_array_equal(
        view(turned(POINTS_M, math.radians(3 * sectors))), np.roll(driven, -sectors, axis=1)
    )


def test_every_repeat_is_another_angle_whatever_their_number() -> None:
    five = drawn(Turned())
    assert five[0] == 0.0
    assert len(set(five)) == 6
    assert drawn(Turned(repeats=2)) == five[:3]
    assert set(drawn(Turned(seed=1))) & set(five) == set(drawn(Turned(), 8)) & set(five) == {0.0}


def test_angles_lie_all_around() -> None:
    angles = np.array([drawn(Turned(repeats=1), stamp)[1] for stamp in range(400)])
    assert angles.min() >= 0
    assert angles.max() < 2 * math.pi
    # the mean of 400 of U[0, 2π) is π ± 0.09; a quarter of them, 100 ± 9, lie in each quadrant
    assert np.abs(np.bincount((angles / (math.pi / 2)).astype(int), minlength=4) - 100).max() < 35
