"""Level maps: which cells beams make walls or free, and which grids are refused."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.level.level_map import FREE, OCCUPIED, UNKNOWN, Drawing, LevelMap


def test_a_beam_makes_cells_free_on_its_way_and_a_wall_where_it_ends() -> None:
    # from (.05, .05) to (.45, .05) in cells of .1 m: four cells are passed, the fifth is a wall
    pose = np.eye(4)
    pose[:2, 3] = 0.05
    level_map = Drawing.of([np.array([[0.4, 0.0]])], pose[None], cell_m=0.1).level_map()
    row = round(-level_map.origin[1] / 0.1)
    col = round(-level_map.origin[0] / 0.1)
    assert level_map.occupancy[row, col : col + 6].tolist() == [FREE] * 4 + [OCCUPIED, UNKNOWN]
    assert (level_map.occupancy[row + 1] == UNKNOWN).all()


def test_a_cell_is_a_wall_if_a_quarter_of_its_beams_end_there() -> None:
    # one beam ends in the cell. If two pass it, 1/3 of its beams end there; if four do, 1/5
    hits = [np.array([[1.0, 0.0]]), *[np.array([[2.0, 0.0]])] * 4]
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :2, 3] = 0.05

    def cell(count: int) -> int:
        """The cell where the first beam ends, in a map of the first `count` beams."""
        level_map = Drawing.of(hits[:count], poses[:count], cell_m=0.1).level_map()
        row = round(-level_map.origin[1] / 0.1)
        return int(level_map.occupancy[row, round((1.05 - level_map.origin[0]) / 0.1 - 0.5)])

    assert cell(3) == OCCUPIED
    assert cell(5) == FREE


def test_a_map_without_a_sweep_is_as_if_it_had_never_been_drawn() -> None:
    noise = np.random.default_rng(3)
    hits = [noise.uniform(1, 5, (30, 2)) for _ in range(4)]
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :2, 3] = noise.uniform(0, 2, (4, 2))
    drawing = Drawing.of(hits, poses, cell_m=0.1)
    subtracted = drawing.level_map(np.array([False, False, True, False]))
    others = [0, 1, 3]
    never_drawn = Drawing.of([hits[row] for row in others], poses[others], cell_m=0.1).level_map()
    for value in (OCCUPIED, FREE):
        count = (subtracted.occupancy == value).sum()
        assert count == (never_drawn.occupancy == value).sum()


def test_hits_beyond_the_range_are_no_walls_but_make_cells_free_up_to_it() -> None:
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
def test_a_grid_that_is_no_map_is_refused_in_a_line(
    cells: list[list[int]], cell_m: float, origin: tuple[float, float, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        LevelMap(np.array(cells, np.int8), cell_m, origin)
