"""Tests the ground of a 3-D map: its planes, and ground that was cut off."""

import numpy as np
import pytest

from pipeline.mapping.local_ground import USUAL_CUT_M, LocalGround
from tests.mapping.town import town

INSIDE_M = np.argwhere(np.ones((6, 6))) * 20.0 + 30.0
"""(36, 2) positions well inside of the town."""


def ground_of(points_m: np.ndarray, cut_m: float | None = None) -> LocalGround:
    return LocalGround.of([points_m], cut_m)


def sloped(points_m: np.ndarray, x_slope: float, y_slope: float) -> np.ndarray:
    """The points (n, 3), raised by a plane."""
    raised_m = points_m[:, 0] * x_slope + points_m[:, 1] * y_slope
    return points_m + np.column_stack([np.zeros((len(points_m), 2)), raised_m])


def test_a_tilted_plane_is_recovered() -> None:
    # A slope of .1 along x and −.05 along y: 10 m up at x = 100, and a tilt of
    # arctan(hypot(.1, .05)) = 6.38°.
    map_m = sloped(town(), 0.1, -0.05) + np.array([0, 0, 100])
    ground = ground_of(map_m)
    assert ground.has_ground
    heights_m = ground.heights_m(INSIDE_M)
    np.testing.assert_allclose(heights_m, 100 + INSIDE_M @ [0.1, -0.05], atol=0.1)
    tilt_deg = np.rad2deg(np.arccos(ground.poses(INSIDE_M)[:, 2, 2]))
    np.testing.assert_allclose(tilt_deg, 6.38, atol=0.5)  # slopes are pulled to 0 by some 5 %


def test_anchors_stand_on_the_slope_and_look_along_x() -> None:
    ground = ground_of(sloped(town(), 0.1, 0.0))
    poses = ground.poses(INSIDE_M)
    np.testing.assert_allclose(poses[:, :2, 3], INSIDE_M)
    # Uphill along x: (cos, 0, sin) of arctan(.1); the normal is (−sin, 0, cos).
    cosine, sine = np.cos(np.arctan(0.1)), np.sin(np.arctan(0.1))
    np.testing.assert_allclose(poses[:, :3, 0], [[cosine, 0, sine]] * 36, atol=0.02)
    np.testing.assert_allclose(poses[:, :3, 2], [[-sine, 0, cosine]] * 36, atol=0.02)
    products = np.swapaxes(poses[:, :3, :3], 1, 2) @ poses[:, :3, :3]
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), (36, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)


def test_ground_that_was_cut_off_is_noticed_and_lies_below_the_points() -> None:
    map_m = town()
    cut_m = map_m[map_m[:, 2] > USUAL_CUT_M]
    ground = ground_of(cut_m)
    # The columns of walls have a point near the lowest ones of their cell, but points above it too.
    assert not ground.has_ground
    np.testing.assert_allclose(ground.heights_m(INSIDE_M), 0.0, atol=0.25)


@pytest.mark.parametrize("height_m", [0.3, 0.8])
def test_the_height_of_the_cut_may_be_told(height_m: float) -> None:
    map_m = town()
    ground = ground_of(map_m[map_m[:, 2] > height_m], height_m)
    assert not ground.has_ground
    # The lowest 2 % of the points of walls as high as 9 m lie .1 m above their lower ends.
    np.testing.assert_allclose(ground.heights_m(INSIDE_M), 0.0, atol=0.3)


def test_roofs_do_not_lift_the_ground() -> None:
    # A hall of 20 by 20 m whose roof, at 6 m, hides the ground of four cells.
    map_m = town()
    is_under = (np.abs(map_m[:, :2] - 80) < 10).all(axis=1)
    steps = np.arange(70.2, 90, 0.4)
    x, y = np.meshgrid(steps, steps)
    roof_m = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 6.0)])
    ground = ground_of(np.concatenate([map_m[~is_under], roof_m]))
    middles_m = np.array([[75.0, 75], [75, 85], [85, 75], [85, 85]])
    assert np.abs(ground.heights_m(middles_m)).max() < 0.5


def test_there_is_no_ground_far_from_all_points() -> None:
    ground = ground_of(town(side_m=60.0))
    # Candidates count up to 40 m away, and nothing lies 100 m away.
    away_m = np.array([[-100.0, 0.0], [160.0, 30.0], [1e6, -1e6]])
    assert np.isnan(ground.heights_m(away_m)).all()
    assert np.isnan(ground.poses(away_m)[:, 2, 3]).all()
    assert np.isfinite(ground.heights_m(np.array([[30.0, 30.0], [-15.0, 30.0]]))).all()


def test_tiles_one_by_one_give_the_same_ground() -> None:
    map_m = town(side_m=100.0)
    tile = np.floor(map_m[:, :2] / 50).astype(int) @ [2, 1]
    tiles_m = [map_m[tile == number] for number in range(4)]
    np.testing.assert_array_equal(LocalGround.of(tiles_m).planes, ground_of(map_m).planes)


def test_a_map_of_few_points_a_cell_has_no_ground() -> None:
    # 9 points: a candidate takes 10 in a cell.
    points_m = np.argwhere(np.ones((3, 3, 1))).astype(float)
    assert np.isnan(ground_of(points_m).heights_m(np.array([[1.0, 1.0]]))).all()
