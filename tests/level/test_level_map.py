"""Level maps: what beams make of cells, and which grids are no maps."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.level.level_map import FREE, OCCUPIED, UNKNOWN, Drawing, LevelMap


def test_a_beam_frees_what_it_passes_and_builds_where_it_ends() -> None:
    # from (.05, .05) to (.45, .05) in cells of .1 m: four cells are passed, the fifth is a wall
    pose = np.eye(4)
    pose[:2, 3] = 0.05
    level_map = Drawing.of([np.array([[0.4, 0.0]])], pose[None], cell_m=0.1).level_map()
    row = round(-level_map.origin[1] / 0.1)
    col = round(-level_map.origin[0] / 0.1)
    assert level_map.occupancy[row, col : col + 6].tolist() == [FREE] * 4 + [OCCUPIED, UNKNOWN]
    assert (level_map.occupancy[row + 1] == UNKNOWN).all()


def test_who_passes_once_is_no_wall() -> None:
    # one beam ends where four pass: 1/5 is below the share of a wall, of two passing 1/3 is not
    hits = [np.array([[1.0, 0.0]]), *[np.array([[2.0, 0.0]])] * 4]
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :2, 3] = 0.05

    def cell(count: int) -> int:
        level_map = Drawing.of(hits[:count], poses[:count], cell_m=0.1).level_map()
        row = round(-level_map.origin[1] / 0.1)
        return int(level_map.occupancy[row, round((1.05 - level_map.origin[0]) / 0.1 - 0.5)])

    assert cell(3) == OCCUPIED
    assert cell(5) == FREE


def test_a_sweep_left_out_leaves_the_map_as_if_it_had_never_been() -> None:
    noise = np.random.default_rng(3)
    hits = [noise.uniform(1, 5, (30, 2)) for _ in range(4)]
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :2, 3] = noise.uniform(0, 2, (4, 2))
    drawing = Drawing.of(hits, poses, cell_m=0.1)
    without = drawing.level_map(np.array([False, False, True, False]))
    rest = [0, 1, 3]
    alone = Drawing.of([hits[row] for row in rest], poses[rest], cell_m=0.1).level_map()
    assert (without.occupancy == OCCUPIED).sum() == (alone.occupancy == OCCUPIED).sum()
    assert (without.occupancy == FREE).sum() == (alone.occupancy == FREE).sum()


def test_hits_too_far_away_free_the_way_and_build_nothing() -> None:
    pose = np.eye(4)[None]
    hits = np.array([[80.0, 0.0], [0.0, 2.0], [np.nan, 1.0], [np.inf, 1.0]])
    level_map = Drawing.of([hits], pose, cell_m=0.1, range_m=10.0).level_map()
    assert level_map.walls.sum() == 1
    assert level_map.occupancy.shape[1] < 120
    with pytest.raises(InputError, match="no sweep has a hit within 10 m"):
        Drawing.of([hits[:1]], pose, cell_m=0.1, range_m=10.0)


@pytest.mark.parametrize(
    ("cells", "cell_m", "origin", "message"),
    [
        ([[0, 100]], 0.001, (0, 0, 0), "cells of 0.001 m: expected 0.01 to 0.5 m"),
        ([[0, 100]], 50.0, (0, 0, 0), "is the resolution given in metres"),
        ([[0, 100]], 0.05, (0, np.nan, 0), "expected finite"),
        ([[0, 0]], 0.05, (0, 0, 0), "a map without walls"),
        ([[-1, 100]], 0.05, (0, 0, 0), "a map without free space"),
        ([[]], 0.05, (0, 0, 0), "expected 1 to"),
    ],
)
def test_a_grid_that_is_no_map_is_one_line(
    cells: list[list[int]], cell_m: float, origin: tuple[float, float, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LevelMap(np.array(cells, np.int8), cell_m, origin)
