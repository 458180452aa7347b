"""The grid of places: the authors' check values (METHODS 2.2, there 1-based), ties, borders."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipeline.core.errors import InputError
from pipeline.core.grid import Grid, around

NCLT = Grid(10.0, (-350.0, 130.0), (-730.0, 120.0))


def test_cells_are_counted_to_the_nearest_whole_number_and_there_is_at_least_one() -> None:
    # 480 / 20 = 24 and 850 / 20 = 42.5, a half that is rounded up.
    shapes = [Grid(cell_m, NCLT.x_m, NCLT.y_m).shape for cell_m in (10.0, 5.0, 20.0)]
    assert shapes == [(48, 85), (96, 170), (24, 43)]
    assert Grid(100.0, (0.0, 1.0), (0.0, 2.0)).shape == (1, 1)


def test_cells_run_along_y_first() -> None:
    cells = np.array([0, 1, 85, 4079])
    centres = np.array([(-345, -725), (-345, -715), (-335, -725), (125, 115)], float)
    np.testing.assert_allclose(NCLT.centre(cells), centres)
    assert NCLT.cell(centres).tolist() == cells.tolist()


def test_positions_fall_into_the_authors_cells_and_those_outside_into_the_border() -> None:
    inside = {(0.1, 0.1): 3048, (0, 0): 2962, (-349, -729): 0, (-9999, 0.1): 73, (-338, -718): 86}
    outside = {
        (1e6, 1e6): 4079,
        (-1e6, -1e6): 0,
        (1e6, -1e6): 47 * 85,
        (1e30, 1e30): 4079,
        (-1e30, 1e30): 84,
    }
    cells = inside | outside
    assert NCLT.cell(np.array([*cells], float)).tolist() == [*cells.values()]


@pytest.mark.parametrize(
    "grid", [NCLT, Grid(5.0, NCLT.x_m, NCLT.y_m), Grid(0.1, (0.0, 7.0), (-1.0, 1.0))]
)
def test_on_a_border_the_lower_cell_wins(grid: Grid) -> None:
    # The border of cells i and i + 1 is i + 1 sides from the low end; both axes at once.
    columns, rows = grid.shape
    x = grid.x_m[0] + np.arange(1, columns) * (grid.x_m[1] - grid.x_m[0]) / columns
    y = grid.y_m[0] + np.arange(1, rows) * (grid.y_m[1] - grid.y_m[0]) / rows
    first_y = np.full_like(x, grid.y_m[0] + 1e-6)
    first_x = np.full_like(y, grid.x_m[0] + 1e-6)
    if (
        grid.cell_m < 1
    ):  # sides that are no whole numbers: the border itself is only known to rounding
        x = x - 1e-9
        y = y - 1e-9
    np.testing.assert_array_equal(
        grid.cell(np.column_stack([x, first_y])), np.arange(columns - 1) * rows
    )
    np.testing.assert_array_equal(grid.cell(np.column_stack([first_x, y])), np.arange(rows - 1))


@given(
    st.lists(st.tuples(st.floats(-400, 200), st.floats(-800, 200)), min_size=1, max_size=5),
    st.sampled_from([5.0, 10.0, 20.0]),
)
@settings(max_examples=50)
def test_no_other_centre_is_nearer(positions: list[tuple[float, float]], cell_m: float) -> None:
    grid = Grid(cell_m, NCLT.x_m, NCLT.y_m)
    xy = np.array(positions)
    centres = grid.centre(np.arange(np.prod(grid.shape)))
    nearest = np.linalg.norm(centres - xy[:, None], axis=2).min(axis=1)
    own = np.linalg.norm(grid.centre(grid.cell(xy)) - xy, axis=1)
    np.testing.assert_allclose(own, nearest, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_position_that_is_no_number_is_refused(bad: float) -> None:
    with pytest.raises(InputError, match="not finite"):
        NCLT.cell(np.array([[0.0, 0.0], [0.0, bad]]))


@pytest.mark.parametrize(
    "wrong", [{"x_m": (1.0, 1.0)}, {"y_m": (1.0, 0.0)}, {"cell_m": 0.0}, {"cell_m": np.nan}]
)
def test_a_grid_without_extent_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Grid(**{"cell_m": 10.0, "x_m": (0.0, 1.0), "y_m": (0.0, 1.0), **wrong})


EIGHTHS = st.integers(-4_000, 4_000).map(lambda eighths: eighths / 8)  # metres, exact in binary


# x = 10 m lies on the border of two 10 m cells, and belongs to the lower: the empty one must be
# below that.
@example([(0.0, 0.0)], 10.0)
@example([(10.0, 5.0), (20.0, 5.0)], 10.0)
@example([(-20.0, 3.0), (-10.0, -7.0)], 10.0)
@given(
    st.lists(st.tuples(EIGHTHS, EIGHTHS), min_size=1, max_size=8),
    st.sampled_from([1.0, 5.0, 10.0, 12.5]),
)
@settings(max_examples=50)
def test_a_grid_around_positions_leaves_its_border_empty(
    positions: list[tuple[float, float]], cell_m: float
) -> None:
    xy = np.array(positions)
    grid = around(xy, cell_m)
    columns, rows = grid.shape
    column, row = np.divmod(grid.cell(xy), rows)
    assert ((column > 0) & (column < columns - 1) & (row > 0) & (row < rows - 1)).all()
    sides = (np.ptp(grid.x_m) / columns, np.ptp(grid.y_m) / rows)
    np.testing.assert_allclose(sides, grid.cell_m)
    away = xy.max(axis=0) + 5 * grid.cell_m
    assert grid.cell(away[None])[0] not in grid.cell(xy)
