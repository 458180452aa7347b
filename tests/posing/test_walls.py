"""Tests of matching walls from above: heading and offset are found, and walls where the map saw
through count against a match."""

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.mapping.wall_chart import SEEN_THROUGH, WALL
from pipeline.posing.walls import Walls, cell_numbers
from tests.posing.scene import planar, scene, seen_from


@pytest.mark.parametrize(
    ("x_m", "y_m", "yaw_deg"), [(0.0, 0.0, 0.0), (3.0, -4.0, 90.0), (-5.0, 2.0, -120.0)]
)
def test_heading_and_offset_are_found(x_m: float, y_m: float, yaw_deg: float) -> None:
    walls = Walls()
    true = planar(x_m, y_m, yaw_deg)
    result = walls.match(
        walls.chart(walls.of(scene())), walls.cells_at_headings(walls.of(seen_from(scene(), true)))
    )
    assert result.target_T_query == pytest.approx(true, abs=1.0)
    assert result.target_T_query[:2, :2] == pytest.approx(true[:2, :2], abs=0.06)
    other = walls.match(
        walls.chart(walls.of(scene(1))), walls.cells_at_headings(walls.of(seen_from(scene(), true)))
    )
    assert result.score > other.score + 0.1


def test_a_chart_knows_walls_and_what_was_seen_through() -> None:
    walls = Walls(cell_m=1.0, margin_m=2.0)
    wall = np.column_stack([np.full(400, 20.5), np.linspace(-10, 10, 400), np.full(400, 2.0)])
    chart, single = (
        walls.chart(walls.of(wall), single=False)[0],
        walls.chart(walls.of(wall), single=True)[0],
    )
    middle = walls.half_width_cells
    assert chart[middle + 20, middle] == WALL
    assert single[middle + 10, middle] == SEEN_THROUGH
    assert single[middle + 30, middle] == 0  # behind the wall
    assert single[middle - 10, middle] == 0  # nothing was seen that way
    assert chart.min() == 0


def test_a_wall_where_the_map_saw_through_counts_against() -> None:
    walls = Walls(offset_m=1.0)
    far = np.column_stack([np.full(400, 30.5), np.linspace(-15, 15, 400), np.full(400, 2.0)])
    new = np.column_stack([np.full(200, 15.5), np.linspace(-5, 5, 200), np.full(200, 2.0)])
    hidden = np.column_stack([np.full(200, 38.5), np.linspace(-5, 5, 200), np.full(200, 2.0)])
    chart = walls.chart(walls.of(far))
    alone, with_new, with_hidden = (
        walls.match(chart, walls.cells_at_headings(walls.of(np.concatenate(parts)))).score
        for parts in ([far], [far, new], [far, hidden])
    )
    assert alone > with_hidden > with_new
    assert alone == pytest.approx(1.0)


def test_a_query_without_walls_matches_nothing() -> None:
    walls = Walls()
    ground = np.column_stack([np.random.default_rng(0).uniform(-20, 20, (500, 2)), np.zeros(500)])
    assert (
        walls.match(walls.chart(walls.of(scene())), walls.cells_at_headings(walls.of(ground))).score
        == 0.0
    )


def test_settings_are_checked() -> None:
    with pytest.raises(
        ConfigError, match=r"walls\.high_m=1.0: expected more than walls\.low_m=2.0"
    ):
        Walls(low_m=2.0, high_m=1.0)
    with pytest.raises(ConfigError, match=r"walls\.cell_m=0"):
        Walls(cell_m=0)


@pytest.mark.parametrize("seed", range(4))
def test_branch_and_bound_finds_what_an_exhaustive_search_finds(seed: int) -> None:
    walls = Walls(cell_m=2.0, headings=24, offset_m=7.0)
    chart = walls.chart(walls.of(scene(seed)))
    turned = walls.cells_at_headings(walls.of(seen_from(scene(seed % 2), planar(3, -2, 50))))
    shifted = turned[:, :, None, None] + np.stack(np.mgrid[-4:5, -4:5], axis=2)
    sums = chart[0][shifted[..., 0], shifted[..., 1]].sum(axis=1, dtype=int)
    assert walls.match(chart, turned).score == sums.max() / (WALL * turned.shape[1])


def test_cells_beyond_the_range_have_middles_of_their_own_too() -> None:
    """The walls of another scan, in which changes are searched for, may lie anywhere."""
    rng = np.random.default_rng(0)
    walls_m = rng.uniform(-300, 300, (2000, 3))
    rows = np.unique(np.floor(walls_m[:, :2]), axis=0) + 0.5
    np.testing.assert_array_equal(Walls(cell_m=1.0, range_m=40.0).middles(walls_m), rows)
    assert Walls().middles(np.empty((0, 3))).shape == (0, 2)


def test_equal_cells_have_one_number() -> None:
    cells = np.array([[2, -5], [2, 7], [-1, 0], [2, -5]])
    assert cell_numbers(cells).tolist() == [39, 51, 5, 39]  # columns -5 to 7 are 13 a row
