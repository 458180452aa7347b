"""The input of the ray caster: the shapes of one day, sorted into the cells of the ground.

A ray is tested only against the shapes in the cells that it crosses.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worlds import Floats
from worlds.layout.ground import Ground
from worlds.layout.shapes import Records


class Scene(NamedTuple):
    """The shapes of a day and the ground, in arrays that compiled code can read.

    Shapes are numbered from 0: boxes first, then cylinders, then crowns.
    """

    boxes: Records
    cylinders: Records
    crowns: Records
    heights_m: Floats
    """(i, j) heights of the ground's knots; cell (i, j) lies between (i, j) and (i + 1, j + 1)."""
    x0_m: float
    """x of knot (0, 0)."""
    y0_m: float
    """y of knot (0, 0)."""
    cell_m: float
    """Distance between knots."""
    starts: NDArray[np.int32]
    """(cells + 1,) where the shapes of each cell start in `items`. Cell (i, j) has the number
    i · columns + j."""
    items: NDArray[np.int32]
    """Numbers of the shapes in each cell, one cell after the other."""
    tops_m: Floats
    """(cells,) the highest point of the shapes in each cell: rays above it skip the cell."""
    relief_m: float
    """How far parts of a wall lie before or behind its plane, at most."""


def build_scene(
    boxes: Records, cylinders: Records, crowns: Records, ground: Ground, relief_m: float = 0.0
) -> Scene:
    """Sort the shapes into the cells of `ground` that their bounding rectangles touch."""
    # 1. Find the bounding rectangle and the top of each shape.
    c = np.abs(boxes["cos_yaw"])
    s = np.abs(boxes["sin_yaw"])
    box_x_m = c * boxes["half_length_m"] + s * boxes["half_width_m"]
    box_y_m = s * boxes["half_length_m"] + c * boxes["half_width_m"]
    radius_m = np.concatenate([cylinders["radius_m"], crowns["radius_m"]])
    reach_m = np.concatenate([np.stack([box_x_m, box_y_m], 1), np.stack([radius_m, radius_m], 1)])
    centres_m = np.concatenate(
        [np.stack([shapes["x_m"], shapes["y_m"]], 1) for shapes in (boxes, cylinders, crowns)]
    )
    shape_tops_m = np.concatenate(
        [boxes["top_m"], cylinders["top_m"], crowns["z_m"] + crowns["half_height_m"]]
    )

    # 2. Find the cells that each rectangle touches; `cells` and `shape_of` list all such pairs.
    rows, columns = np.array(ground.heights_m.shape) - 1
    low_i, low_j = _cell_at(centres_m - reach_m, ground).T
    high_i, high_j = _cell_at(centres_m + reach_m, ground).T
    cells_of_shapes = []
    for i, i_end, j, j_end in zip(low_i, high_i + 1, low_j, high_j + 1, strict=True):
        numbers = np.add.outer(columns * np.arange(i, i_end), np.arange(j, j_end))
        cells_of_shapes.append(numbers.ravel())
    cells = np.concatenate([np.zeros(0, int), *cells_of_shapes])
    cell_counts = np.array([len(shape_cells) for shape_cells in cells_of_shapes], int)
    shape_of = np.repeat(np.arange(len(cells_of_shapes)), cell_counts)

    # 3. Sort the pairs by cell.
    order = cells.argsort(kind="stable")
    starts = np.searchsorted(cells[order], np.arange(rows * columns + 1)).astype(np.int32)
    items = shape_of[order].astype(np.int32)
    tops_m = np.full(rows * columns, -1e9)  # of an empty cell: below every ray
    np.maximum.at(tops_m, cells, shape_tops_m[shape_of])
    return Scene(
        boxes=np.ascontiguousarray(boxes),
        cylinders=np.ascontiguousarray(cylinders),
        crowns=np.ascontiguousarray(crowns),
        heights_m=ground.heights_m,
        x0_m=ground.x0_m,
        y0_m=ground.y0_m,
        cell_m=ground.cell_m,
        starts=starts,
        items=items,
        tops_m=tops_m,
        relief_m=relief_m,
    )


def _cell_at(xy_m: Floats, ground: Ground) -> NDArray[np.int64]:
    """The cells (n, 2) of places (n, 2), or the nearest cells of those off the ground."""
    cells = np.floor((xy_m - (ground.x0_m, ground.y0_m)) / ground.cell_m).astype(int)
    return cells.clip(0, np.array(ground.heights_m.shape) - 2)
