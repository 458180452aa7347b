"""Construction: new walls, where their points lie, and what they hide."""

import math

import numpy as np
import pytest

from pipeline.perturbations.construction import Construction, Wall
from tests.perturbations.made import perturbed

POINTS_M = np.random.default_rng(2).uniform((-40, -40, 0), (40, 40, 15), (2000, 3))
AHEAD = Wall(azimuth_rad=0.0, distance_m=10.0, length_m=8.0, height_m=4.0, skew_rad=0.0)
"""The wall at x = 10 m, from y = −4 to 4 m and from z = 0 to 4 m."""


def made(perturbation: Construction, stamp_ns: int = 3) -> dict[tuple[float, bool], np.ndarray]:
    """The perturbed points of each case, by its number of walls and whether it has shadows."""
    perturbed_cases = zip(
        perturbation.cases, perturbed(perturbation, POINTS_M, stamp_ns), strict=True
    )
    return {(case.level, case.shadow): points for case, (points, _) in perturbed_cases}


def distinct(points: np.ndarray) -> set[tuple[float, ...]]:
    """The points (n, 3) as a set."""
    return {tuple(point) for point in points}


def test_a_wall_is_a_grid_of_points_that_stands_on_the_ground() -> None:
    points = AHEAD.points(0.5)
    assert len(points) == 16 * 8  # 8 m and 4 m by half metres
    np.testing.assert_allclose(points[:, 0], 10)
    np.testing.assert_allclose(np.unique(points[:, 1].round(9)), np.arange(-4, 4, 0.5))
    np.testing.assert_allclose(np.unique(points[:, 2]), np.arange(0, 4, 0.5))


def test_a_skewed_wall_turns_about_its_middle() -> None:
    # To the left, 6 m away, 2 m long, turned by 30°: its middle is (0, 6); along it is (−1, 0) so
    # turned, (−cos 30°, −sin 30°).
    wall = Wall(math.pi / 2, 6.0, 2.0, 3.0, math.radians(30))
    ends = wall.points(1.0)[[0, -1], :2]
    np.testing.assert_allclose(ends, [[math.cos(math.pi / 6), 6.5], [0, 6]], atol=1e-12)


@pytest.mark.parametrize(
    ("point", "hidden"),
    [
        ((9.9, 0.0, 1.0), False),  # before the wall
        ((20.0, 0.0, 1.0), True),
        ((-20.0, 0.0, 1.0), False),  # on the other side of the robot
        ((20.0, 7.9, 1.0), True),  # its ray meets the wall at y = 3.95
        ((20.0, 8.1, 1.0), False),  # at 4.05, beyond the end
        ((20.0, 0.0, 6.9), True),  # from 1 m up: at 1 + 5.9 / 2 = 3.95
        ((20.0, 0.0, 7.1), False),  # at 4.05, over the top
        ((20.0, 0.0, -1.2), True),  # at −0.1: no gap under the base
    ],
)
def test_what_lies_behind_a_wall_is_hidden(point: tuple[float, ...], hidden: bool) -> None:
    assert AHEAD.hides(np.array([point]), 1.0).tolist() == [hidden]


def test_a_nearer_wall_hides_a_farther_one_and_none_itself() -> None:
    farther = AHEAD._replace(distance_m=20.0, length_m=30.0, height_m=3.0)
    assert not AHEAD.hides(AHEAD.points(0.2), 1.3).any()
    assert not farther.hides(AHEAD.points(0.2), 1.3).any()
    y = farther.points(0.2)[:, 1]
    np.testing.assert_array_equal(AHEAD.hides(farther.points(0.2), 1.3), np.abs(y) <= 8)


def test_walls_are_drawn_within_their_ranges_evenly() -> None:
    walls = np.array(Construction().random_walls(2000, np.random.default_rng(0)))
    for numbers, low, high in zip(
        walls.T, (0, 5, 5, 3, -math.pi / 6), (2 * math.pi, 20, 20, 10, math.pi / 6), strict=True
    ):
        assert low <= numbers.min() < numbers.max() < high
        # the mean of 2000 even numbers lies within 4 % of the range's middle: six deviations of 1 /
        # √(12 · 2000)
        assert abs(numbers.mean() - (low + high) / 2) < 0.04 * (high - low)


@pytest.mark.parametrize("stamp_ns", range(4))
def test_new_points_lie_on_the_walls_and_old_ones_stay(stamp_ns: int) -> None:
    points = made(Construction(), stamp_ns)[2, False]
    np.testing.assert_array_equal(points[:2000], POINTS_M)
    start = 2000
    for azimuth, distance_m, length_m, height_m, skew in Construction().random_walls(
        2, np.random.default_rng((0, stamp_ns))
    ):
        count = math.ceil(length_m / 0.2) * math.ceil(height_m / 0.2)
        own = points[start : start + count]
        start = start + count
        x = own[:, 0] - distance_m * math.cos(azimuth)
        y = own[:, 1] - distance_m * math.sin(azimuth)
        off_m = math.cos(azimuth + skew) * x + math.sin(azimuth + skew) * y
        along_m = np.hypot(x, y)
        np.testing.assert_allclose(off_m, 0, atol=1e-9)
        assert length_m / 2 - 0.2 < along_m.max() < length_m / 2 + 1e-9
        assert own[:, 2].min() == 0
        assert height_m - 0.2 <= own[:, 2].max() < height_m
    assert start == len(points)


def test_every_level_has_the_walls_of_the_one_before() -> None:
    cases = made(Construction())
    assert list(cases) == [
        (0, False),
        (1, False),
        (2, False),
        (3, False),
        (1, True),
        (2, True),
        (3, True),
    ]
    for count in (1, 2, 3):
        assert distinct(cases[count, False]) > distinct(cases[count - 1, False])
        assert distinct(cases[count, True]) < distinct(cases[count, False])
    for count in (2, 3):  # what one more wall hides is hidden, what it does not hide is as it was
        assert distinct(cases[count, True]) & distinct(POINTS_M) <= distinct(
            cases[count - 1, True]
        ) & distinct(POINTS_M)
