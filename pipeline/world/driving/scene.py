"""The shapes of one day, sorted into the cells of the ground.

A ray is tested only against shapes in its cells.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.world import Floats
from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import Records


class Scene(NamedTuple):
    """The input of the ray caster.

    Shapes are numbered: boxes first, then cylinders, then crowns.
    """

    boxes: Records
    cylinders: Records
    crowns: Records
    heights_m: Floats
    """(i, j) knots of the ground; cell (i, j) lies between knots i and i + 1, j and j + 1."""
    x0_m: float
    y0_m: float
    cell_m: float
    starts: NDArray[np.int32]
    """(cells + 1,) start of the shapes of each cell in `items`; cell (i, j) has the number i ×
    columns + j."""
    items: NDArray[np.int32]
    """Numbers of the shapes in each cell, one cell after the other."""
    tops_m: Floats
    """(cells,) the highest point of the shapes in a cell: rays above it skip the cell."""
    relief_m: float
    """How far parts of a wall lie in front of its plane, or behind it, at most."""


def build_scene(
    boxes: Records, cylinders: Records, crowns: Records, ground: Ground, relief_m: float = 0.0
) -> Scene:
    """Sort the shapes into the cells of `ground` that their bounding rectangles touch."""
    c, s, half_length_m, half_width_m = (
        boxes[name] for name in ("cos_yaw", "sin_yaw", "half_length_m", "half_width_m")
    )
    c = np.abs(c)
    s = np.abs(s)
    round_m = np.concatenate([cylinders["radius_m"], crowns["radius_m"]])
    box_m = np.stack(
        [c * half_length_m + s * half_width_m, s * half_length_m + c * half_width_m], 1
    )
    reach_m = np.concatenate([box_m, np.stack([round_m, round_m], 1)])
    centres_m = np.concatenate(
        [np.stack([shapes["x_m"], shapes["y_m"]], 1) for shapes in (boxes, cylinders, crowns)]
    )
    tops = np.concatenate(
        [boxes["top_m"], cylinders["top_m"], crowns["z_m"] + crowns["half_height_m"]]
    )
    rows, columns = np.array(ground.heights_m.shape) - 1
    (low_i, low_j), (high_i, high_j) = (
        np.floor((edge_m - (ground.x0_m, ground.y0_m)) / ground.cell_m)
        .astype(int)
        .clip(0, (rows - 1, columns - 1))
        .T
        for edge_m in (centres_m - reach_m, centres_m + reach_m)
    )
    spans = zip(low_i, high_i + 1, low_j, high_j + 1, strict=True)
    touched = [
        np.add.outer(columns * np.arange(i, i_end), np.arange(j, j_end)).ravel()
        for i, i_end, j, j_end in spans
    ]
    cells = np.concatenate([np.zeros(0, int), *touched])
    shape_of = np.repeat(
        np.arange(len(touched)), np.array([len(shape_cells) for shape_cells in touched], int)
    )
    order = cells.argsort(kind="stable")
    starts = np.searchsorted(cells[order], np.arange(rows * columns + 1)).astype(np.int32)
    tops_m = np.full(rows * columns, -1e9)
    np.maximum.at(tops_m, cells, tops[shape_of])
    shapes = (
        np.ascontiguousarray(boxes),
        np.ascontiguousarray(cylinders),
        np.ascontiguousarray(crowns),
    )
    items = shape_of[order].astype(np.int32)
    return Scene(
        *shapes,
        ground.heights_m,
        ground.x0_m,
        ground.y0_m,
        ground.cell_m,
        starts,
        items,
        tops_m,
        relief_m,
    )
