"""Tests of heights above the ground: a slope is ground, and things on a slope stand on it."""

import numpy as np
import pytest

from pipeline.mapping.heights import heights_m
from pipeline.posing.walls import Walls


def hill(slope: float, n: int = 40_000) -> np.ndarray:
    """Ground that climbs along x, 50 m around."""
    rng = np.random.default_rng(0)
    x_m, y_m = rng.uniform(-50, 50, (2, n))
    return np.column_stack([x_m, y_m, slope * x_m])


def pole(x_m: float, slope: float) -> np.ndarray:
    """4 m high, on the hill."""
    up_m = np.linspace(0, 4, 41)
    return np.column_stack([np.full(41, x_m), np.full(41, 0.2), slope * x_m + up_m])


@pytest.mark.parametrize("slope", [-0.12, 0.0, 0.12])
def test_a_hillside_is_no_wall_and_a_pole_on_it_is_as_high_as_it_is(slope: float) -> None:
    ground_m = hill(slope)
    assert np.abs(heights_m(ground_m)).max() < 0.6
    assert len(Walls().of(ground_m)) == 0
    points_m = np.concatenate([ground_m, pole(30.0, slope)])
    assert heights_m(points_m)[-1] == pytest.approx(4.0, abs=0.3)
    assert len(Walls().of(points_m)) == pytest.approx(30, abs=3)


def test_a_roof_that_is_seen_without_its_walls_is_no_ground() -> None:
    ground_m = hill(0.0)
    roof_m = ground_m[np.abs(ground_m[:, 0] - 30) < 5] + np.array([0.0, 0.0, 3.0])
    seen_m = np.concatenate([ground_m[ground_m[:, 0] < 20], roof_m])
    assert heights_m(seen_m)[-len(roof_m) :] == pytest.approx(3.0, abs=0.01)


def test_no_points_have_no_heights() -> None:
    assert heights_m(np.empty((0, 3))).shape == (0,)


def test_a_point_that_is_not_finite_has_no_height_and_a_far_one_moves_nothing() -> None:
    ground_m = hill(0.0)
    odd_m = np.array([[np.nan, 0, 0], [0, np.inf, 5], [1e9, 0, 2]])
    heights = heights_m(np.concatenate([ground_m, odd_m]))
    assert np.abs(heights[: len(ground_m)]).max() == 0
    assert np.isnan(heights[-3:-1]).all()
    assert heights[-1] == 2.0
    assert len(Walls().of(np.concatenate([ground_m, odd_m]))) == 0
