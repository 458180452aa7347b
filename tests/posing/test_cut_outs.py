"""Tests the cut-outs of a 3-D map, which scans are registered with."""

import numpy as np
import pytest

from pipeline.online.map_pack import MapOptions, parts_of_points
from pipeline.online.site import Site
from pipeline.posing.cut_outs import CutOuts
from pipeline.posing.targets import Targets
from pipeline.posing.walls import Walls
from tests.mapping.town import town

MAP_M = town(5, 120.0)
SLOPE = 0.1


@pytest.fixture(scope="module")
def level() -> CutOuts:
    return cut_outs(MAP_M)


def cut_outs(map_m: np.ndarray) -> CutOuts:
    targets = Site(parts_of_points(map_m, "town", MapOptions())).targets
    assert isinstance(targets, CutOuts)
    return targets


def row_at(targets: Targets, x_m: float, y_m: float) -> int:
    """The row whose anchor is nearest to a position."""
    away_m = np.linalg.norm(targets.world_T_anchor[:, :2, 3] - (x_m, y_m), axis=1)
    return int(away_m.argmin())


def test_a_cut_out_has_the_points_around_its_anchor_in_the_anchors_frame(level: CutOuts) -> None:
    row = row_at(level, 60, 60)
    anchor_m = level.world_T_anchor[row, :3, 3]
    points_m = level.points_m(row)
    assert np.hypot(points_m[:, 0], points_m[:, 1]).max() < level.range_m
    # The world's x axis is the anchor's, so the points are those of the map moved to the anchor.
    world_m = np.concatenate(list(level.tiled_map.tiles_m()))
    away_m = np.linalg.norm(world_m[:, :2] - anchor_m[:2], axis=1)
    assert len(points_m) == np.count_nonzero(away_m < level.range_m)
    np.testing.assert_allclose(
        np.sort(points_m[:, 0]), np.sort(world_m[away_m < level.range_m, 0] - anchor_m[0]), atol=0.2
    )
    assert abs(np.median(points_m[:, 2])) < 0.1


def test_on_a_slope_the_ground_of_a_cut_out_is_level() -> None:
    raised_m = MAP_M + np.outer(MAP_M[:, 0] * SLOPE, [0, 0, 1])
    targets = cut_outs(raised_m)
    row = row_at(targets, 60, 60)
    points_m = targets.points_m(row)
    near_m = points_m[np.hypot(points_m[:, 0], points_m[:, 1]) < 20]
    # Seen from the anchor the slope of .1 has all but gone: over 40 m it would rise by 4 m.
    slope = np.polyfit(near_m[near_m[:, 2] < 0.5, 0], near_m[near_m[:, 2] < 0.5, 2], 1)[0]
    assert abs(slope) < 0.02


def test_the_window_of_the_map_is_the_chart_of_the_points(level: CutOuts) -> None:
    walls = Walls(range_m=30.0)
    for x_m, y_m in ((60, 60), (20, 90)):
        row = row_at(level, x_m, y_m)
        window = level.chart(walls, row)
        drawn = Targets._chart(level, walls, row)
        assert window.shape == drawn.shape
        # The points are drawn up to 30 m, the window up to its border; so compare within 28 m.
        side_m = np.arange(drawn.shape[1]) - drawn.shape[1] / 2 + 0.5
        is_near = np.hypot(side_m[:, None], side_m) < 28
        assert (drawn[0][is_near] > 0).sum() > 100
        # A point on the edge of two cells, or of a height just at 1 m, may be drawn differently.
        assert (window[0][is_near] == drawn[0][is_near]).mean() > 0.98


def test_cells_of_another_size_are_drawn_from_the_points(level: CutOuts) -> None:
    walls = Walls(cell_m=2.0, range_m=30.0)
    row = row_at(level, 60, 60)
    np.testing.assert_array_equal(level.chart(walls, row), Targets._chart(level, walls, row))


def test_walls_are_what_stands_above_the_ground(level: CutOuts) -> None:
    walls_m = level.above_ground_m(0.3)
    world_m = np.concatenate(list(level.tiled_map.tiles_m()))
    # The ground of the made town lies at 0, and is fitted to some centimetres.
    assert len(walls_m) == pytest.approx(np.count_nonzero(world_m[:, 2] > 0.3), rel=0.05)
    assert walls_m[:, 2].min() > 0.15


def test_another_grain_is_refused(level: CutOuts) -> None:
    with pytest.raises(ValueError, match=r"grain_m=0\.02: expected 0\.01"):
        CutOuts(level._arrays, level.drawn, 0.02, 60.0)
