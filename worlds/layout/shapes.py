"""The shapes that a ray can hit, as numpy records: boxes, upright cylinders, and ellipsoid crowns.

Coordinates are in metres in the world. A shape stands on the days born_day <= day < dead_day; day 0
is the date of the training sequence.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from worlds import Floats

Records: TypeAlias = NDArray[Any]
"""Records (n,) of one of the types BOX, CYLINDER and CROWN."""
ALWAYS = (-np.inf, np.inf)
"""(born_day, dead_day) of a shape that stands all year."""


class Kind(IntEnum):
    """What a shape belongs to; the ground truth tells the kind of every point."""

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
    """The species of a shape, which determines how porous it is over the year.

    `driving.day.extinction_per_m` gives the extinction of each.
    """

    SOLID = -1
    DECIDUOUS = 0
    CONIFER = 1
    HEDGE = 2
    PALES = 3
    """Pickets, mesh and spokes: half open all year."""


def _record(*lengths: str) -> np.dtype[Any]:
    """The type of a record with these lengths, and the fields that all shapes share."""
    floats = [*lengths, "reflectance", "extinction_per_m", "born_day", "dead_day"]
    integers = ["kind", "species"]
    return np.dtype([(name, "f8") for name in floats] + [(name, "i8") for name in integers])


BOX = _record(
    "x_m", "y_m", "half_length_m", "half_width_m", "cos_yaw", "sin_yaw", "bottom_m", "top_m"
)
CYLINDER = _record("x_m", "y_m", "radius_m", "bottom_m", "top_m")
CROWN = _record("x_m", "y_m", "z_m", "radius_m", "half_height_m")


def records(dtype: np.dtype[Any], **columns: object) -> Records:
    """Make records from columns (n,), or single values that all of them share.

    Shapes are solid and stand all year unless the columns say otherwise; other missing fields are
    0.
    """
    length = np.broadcast_shapes(*(np.shape(np.asarray(column)) for column in columns.values()))
    table = np.zeros(length or (1,), dtype)
    table["born_day"], table["dead_day"] = ALWAYS
    table["species"] = Species.SOLID
    for name, column in columns.items():
        table[name] = column
    return table


def columns(things: Sequence[Any], *names: str) -> dict[str, Floats]:
    """The attributes `names` of all n `things`, each as an array (n,)."""
    return {name: np.array([getattr(thing, name) for thing in things], float) for name in names}


def standing(shapes: Records, day: int) -> Records:
    """The shapes that stand on `day`."""
    return shapes[(shapes["born_day"] <= day) & (day < shapes["dead_day"])]
