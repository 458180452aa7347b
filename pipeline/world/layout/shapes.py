"""The shapes that a ray can hit: boxes, upright cylinders and porous crowns, as numpy records.

World frame, metres. A shape stands on the days born_day <= day < dead_day; day 0 is the training
sequence's date.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.world import Floats

Records: TypeAlias = NDArray[Any]
ALWAYS = (-np.inf, np.inf)
"""(born_day, dead_day) of a shape that stands all year."""


class Kind(IntEnum):
    """The kind of a point in the truth."""

    NOTHING = 0
    GROUND = 1
    BUILDING = 2
    CAR = 3
    POLE = 4
    LEAF = 5
    PERSON = 6
    TRUNK = 7
    WORKS = 8
    """The fence and the mound of a construction site."""
    CLUTTER = 9
    """Bins, benches, cabinets."""
    BORDER = 10
    """Garden walls and fences."""


class Species(IntEnum):
    """The species of a porous shape, which determines its extinction over the year
    (`day.extinction_per_m`)."""

    SOLID = -1
    DECIDUOUS = 0
    CONIFER = 1
    HEDGE = 2
    PALES = 3
    """Pickets, mesh, spokes: half open all year."""


def _record(*lengths: str) -> np.dtype[Any]:
    """All shapes share their last fields; 8 bytes per field keep the records aligned."""
    tail = ["reflectance", "extinction_per_m", "born_day", "dead_day"]
    return np.dtype(
        [(name, "f8") for name in [*lengths, *tail]] + [("kind", "i8"), ("species", "i8")]
    )


BOX = _record(
    "x_m", "y_m", "half_length_m", "half_width_m", "cos_yaw", "sin_yaw", "bottom_m", "top_m"
)
CYLINDER = _record("x_m", "y_m", "radius_m", "bottom_m", "top_m")
CROWN = _record("x_m", "y_m", "z_m", "radius_m", "half_height_m")


def records(dtype: np.dtype[Any], **columns: object) -> Records:
    """Records from columns (n,) or single values.

    Fields not given are 0, and the shape is solid and stands all year.
    """
    length = np.broadcast_shapes(*(np.shape(np.asarray(column)) for column in columns.values()))
    table = np.zeros(length or (1,), dtype)
    table["born_day"], table["dead_day"] = ALWAYS
    table["species"] = Species.SOLID
    for name, column in columns.items():
        table[name] = column
    return table


def columns(things: Sequence[Any], *names: str) -> dict[str, Floats]:
    """These attributes of `things`, each as an array (n,)."""
    return {name: np.array([getattr(thing, name) for thing in things], float) for name in names}


def standing(shapes: Records, day: int) -> Records:
    """The shapes that stand on `day`."""
    return shapes[(shapes["born_day"] <= day) & (day < shapes["dead_day"])]
