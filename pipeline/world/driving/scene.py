"""The shapes of one day, sorted into the cells of the ground, so that a ray is tested only against shapes in its cells."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import Records


class Scene(NamedTuple):
    """The input of the ray caster. Shapes are numbered: boxes first, then cylinders, then crowns."""

    boxes: Records
    cylinders: Records
    crowns: Records
    heights_m: NDArray[np.float64]
    """(i, j) knots of the ground; cell (i, j) lies between knots i and i + 1, j and j + 1."""
    x0_m: float
    y0_m: float
    cell_m: float
    starts: NDArray[np.int32]
    """(cells + 1,) start of the shapes of each cell in `items`; cell (i, j) has the number i × columns + j."""
    items: NDArray[np.int32]
    """Numbers of the shapes in each cell, one cell after the other."""
    tops_m: NDArray[np.float64]
    """(cells,) the highest point of the shapes in a cell: rays above it skip the cell."""


def build_scene(boxes: Records, cylinders: Records, crowns: Records, ground: Ground) -> Scene:
    """Sort the shapes into the cells of `ground`."""
    turn = np.abs(boxes["cos_yaw"]), np.abs(boxes["sin_yaw"])
    box_reach = [
        turn[0] * boxes["half_length_m"] + turn[1] * boxes["half_width_m"],
        turn[1] * boxes["half_length_m"] + turn[0] * boxes["half_width_m"],
    ]
    round_reach = np.concatenate([cylinders["radius_m"], crowns["radius_m"]])
    centres = np.concatenate([np.stack([shapes["x_m"], shapes["y_m"]], 1) for shapes in (boxes, cylinders, crowns)])
    reach = np.stack([np.concatenate([box_reach[axis], round_reach]) for axis in (0, 1)], 1)
    tops = np.concatenate([boxes["top_m"], cylinders["top_m"], crowns["z_m"] + crowns["half_height_m"]])
    cells = np.array(ground.heights_m.shape) - 1
    corner = np.array([ground.x0_m, ground.y0_m])
    low = np.floor((centres - reach - corner) / ground.cell_m).astype(np.int64).clip(0, cells - 1)
    high = np.floor((centres + reach - corner) / ground.cell_m).astype(np.int64).clip(0, cells - 1)
    starts, items, tops_m = _sort(low, high, tops, int(cells[0]), int(cells[1]))
    shapes = (np.ascontiguousarray(boxes), np.ascontiguousarray(cylinders), np.ascontiguousarray(crowns))
    return Scene(*shapes, ground.heights_m, ground.x0_m, ground.y0_m, ground.cell_m, starts, items, tops_m)


@njit(cache=True, nogil=True, error_model="numpy")
def _sort(
    low: NDArray[np.int64], high: NDArray[np.int64], tops: NDArray[np.float64], rows: int, columns: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Counting sort of the shapes into every cell that their bounding rectangles touch."""
    starts = np.zeros(rows * columns + 1, np.int32)
    tops_m = np.full(rows * columns, -1e9)
    for shape in range(low.shape[0]):
        for i in range(low[shape, 0], high[shape, 0] + 1):
            for j in range(low[shape, 1], high[shape, 1] + 1):
                starts[i * columns + j + 1] += 1
                tops_m[i * columns + j] = max(tops_m[i * columns + j], tops[shape])
    starts = np.cumsum(starts).astype(np.int32)
    items = np.empty(starts[-1], np.int32)
    filled = starts.copy()
    for shape in range(low.shape[0]):
        for i in range(low[shape, 0], high[shape, 0] + 1):
            for j in range(low[shape, 1], high[shape, 1] + 1):
                items[filled[i * columns + j]] = shape
                filled[i * columns + j] += 1
    return starts, items, tops_m
