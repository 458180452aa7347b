"""Structures of boxes: buildings, houses, hedges, fences.

The same parts may stand in many places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.world import Floats
from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import ALWAYS, BOX, Kind, Records, Species, columns, records

FOOTING_M = 1.5
"""Depth of a part below the ground that it stands on, so that there is no gap on slopes."""
REFLECTANCE = 0.4


@dataclass(frozen=True)
class Part:
    """One box, in its structure's frame: x along its length, y to its left."""

    ahead_m: float
    left_m: float
    half_length_m: float
    half_width_m: float
    bottom_m: float
    top_m: float


@dataclass(frozen=True)
class Structure:
    """Parts at a point with a yaw, on the days born_day <= day < dead_day."""

    x_m: float
    y_m: float
    yaw_rad: float
    parts: tuple[Part, ...]
    kind: Kind = Kind.BUILDING
    species: Species = Species.SOLID
    born_day: float = ALWAYS[0]
    dead_day: float = ALWAYS[1]

    def to_world(self, ahead_left_m: Floats) -> Floats:
        """World points (..., 2) in metres of points in the frame of the structure."""
        c = np.cos(self.yaw_rad)
        s = np.sin(self.yaw_rad)
        return np.asarray(ahead_left_m @ np.array([[c, s], [-s, c]]) + (self.x_m, self.y_m))

    def outline_m(self) -> Floats:
        """World points (15 per part, 2) spread over its footprint, to test whether it fits."""
        u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 3)))
        spread = [
            (part.ahead_m + u * part.half_length_m, part.left_m + v * part.half_width_m)
            for part in self.parts
        ]
        return self.to_world(np.concatenate(spread, axis=1).T)

    def discs_m(self) -> Floats:
        """Discs (5 per part, 3) of x, y, radius that cover its footprint, to keep others at a
        distance."""
        discs = []
        for part in self.parts:
            along_x = part.half_length_m >= part.half_width_m
            short_m, long_m = sorted((part.half_length_m, part.half_width_m))
            reach_m = np.linspace(-1, 1, 5) * (long_m - short_m)
            centres = np.stack(
                [part.ahead_m + reach_m * along_x, part.left_m + reach_m * (not along_x)], 1
            )
            discs.append(
                np.column_stack([self.to_world(centres), np.full(5, 1.15 * short_m + 1.5)])
            )
        return np.concatenate(discs)

    def half_extent_m(self) -> Floats:
        """The largest distance (2,) of its parts from its own origin, along its length and to its
        sides."""
        reaches = [
            (abs(part.ahead_m) + part.half_length_m, abs(part.left_m) + part.half_width_m)
            for part in self.parts
        ]
        return np.asarray(np.max(reaches, axis=0))


def boxes(structures: Sequence[Structure], ground: Ground) -> Records:
    """The boxes of all `structures`.

    The base of each part is the height of the ground at its centre.
    """
    pairs = [(structure, part) for structure in structures for part in structure.parts]
    table = columns(
        [part for _, part in pairs], "half_length_m", "half_width_m", "bottom_m", "top_m"
    )
    table |= columns(
        [structure for structure, _ in pairs], "yaw_rad", "born_day", "dead_day", "kind", "species"
    )
    centres = [
        structure.to_world(np.array([part.ahead_m, part.left_m])) for structure, part in pairs
    ]
    table["x_m"], table["y_m"] = np.reshape(centres, (-1, 2)).T
    base_m = ground.at(table["x_m"], table["y_m"])
    bottom_m = table["bottom_m"]
    yaw = table.pop("yaw_rad")
    table["bottom_m"] = base_m + np.where(bottom_m == 0, -FOOTING_M, bottom_m)
    table["top_m"] += base_m
    return records(BOX, cos_yaw=np.cos(yaw), sin_yaw=np.sin(yaw), reflectance=REFLECTANCE, **table)
