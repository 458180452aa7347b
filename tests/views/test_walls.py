"""Tests a scan's walls from above as a view."""

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, InputError
from pipeline.mapping.wall_chart import SEEN_THROUGH, WALL
from pipeline.views.walls import Walls

SMALL = Walls(range_m=10.0)


def wall(x_m: float, low_m: float = 0.0, high_m: float = 3.0) -> np.ndarray:
    """Points (n, 3) of a wall across x, 8 m wide."""
    y, z = np.meshgrid(np.arange(-3.9, 4, 0.2), np.arange(low_m, high_m, 0.25))
    return np.column_stack([np.full(y.size, x_m), y.ravel(), z.ravel()])


def test_a_wall_ahead_is_drawn_and_the_space_before_it_is_seen_through() -> None:
    image = SMALL(wall(6.5))
    assert image.shape == (20, 20)
    assert image.dtype == np.int8
    # x = 6.5 lies in cell 10 + 6, y from −4 to 4 in the cells 6 to 13.
    expected = np.zeros((20, 20), bool)
    expected[16, 6:14] = True
    np.testing.assert_array_equal(image == WALL, expected)
    # Straight ahead, cells nearer than 6.5 − 2 = 4.5 m are seen through: the next one's centre is
    # at hypot(4.5, .5) = 4.53 m. The first one's lies at 45°, where there is no wall.
    assert image[10:16, 10].tolist() == [0, *3 * [SEEN_THROUGH], 0, 0]
    assert not image[:10].any()  # nothing is known behind the robot


def test_a_turned_scan_gives_a_turned_view() -> None:
    # By 90° to the left, x becomes y; the image turns with it.
    points_m = wall(6.5)
    turned_m = np.column_stack([-points_m[:, 1], points_m[:, 0], points_m[:, 2]])
    np.testing.assert_array_equal(SMALL(turned_m), SMALL(points_m).T[::-1])


def test_only_heights_of_walls_count() -> None:
    # Below 1 m are cars, above 8 m are crowns of trees.
    low = SMALL(wall(6.5, 0.0, 0.9))
    high = SMALL(np.concatenate([wall(6.5, 9.0, 12.0), wall(3.5, 0.0, 0.5)]))
    assert not (low == WALL).any()
    assert not (high == WALL).any()


def test_walls_out_of_range_are_left_out() -> None:
    assert not (SMALL(wall(11.0)) == WALL).any()
    assert (SMALL(wall(9.5)) == WALL).any()


def test_a_scan_without_points_shows_nothing() -> None:
    assert not SMALL(np.empty((0, 3))).any()


def test_ranges_that_are_no_whole_number_of_cells_are_rounded_up() -> None:
    assert Walls(range_m=10.2).shape == (22, 22)
    assert Walls(range_m=10.0, cell_m=0.4).shape == (50, 50)


@pytest.mark.parametrize(
    ("points_m", "said"),
    [
        (np.zeros((5, 2)), r"\(5, 2\): expected \(n, 3\)"),
        (np.zeros(3), r"\(3,\): expected \(n, 3\)"),
        (np.array([[np.nan, 0, 0]]), "NaN or infinite"),
        (np.array([[0, np.inf, 0]]), "NaN or infinite"),
    ],
)
def test_points_of_another_shape_or_not_finite_are_refused(points_m: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        SMALL(points_m)


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"view\.high_m=0\.5: expected more than view\.low_m"):
        Walls(low_m=1.0, high_m=0.5)
    with pytest.raises(ConfigError, match="cell_m"):
        Walls(cell_m=0.0)
