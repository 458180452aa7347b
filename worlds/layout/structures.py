"""Structures of boxes, such as buildings and hedges, and their shapes for the ray caster."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from worlds import Floats
from worlds.layout.ground import Ground
from worlds.layout.shapes import ALWAYS, BOX, Kind, Records, Species, columns, records

FOOTING_M = 1.5
"""How far a part that stands on the ground reaches into it, so that there is no gap on slopes."""
REFLECTANCE = 0.4


@dataclass(frozen=True)
class Part:
    """One box, in the frame of its structure: x ahead along its length, y to the left."""

    ahead_m: float
    """x of its centre."""
    left_m: float
    """y of its centre."""
    half_length_m: float
    half_width_m: float
    bottom_m: float
    """Above the ground under its centre."""
    top_m: float
    """Above the ground under its centre."""


@dataclass(frozen=True)
class Structure:
    """Boxes at a place of the world, turned by a yaw, on the days born_day <= day < dead_day."""

    x_m: float
    y_m: float
    yaw_rad: float
    parts: tuple[Part, ...]
    kind: Kind = Kind.BUILDING
    species: Species = Species.SOLID
    born_day: float = ALWAYS[0]
    dead_day: float = ALWAYS[1]

    def to_world(self, ahead_left_m: Floats) -> Floats:
        """World points (…, 2) of points (…, 2) in the frame of the structure."""
        c = np.cos(self.yaw_rad)
        s = np.sin(self.yaw_rad)
        return np.asarray(ahead_left_m @ np.array([[c, s], [-s, c]]) + (self.x_m, self.y_m))

    def footprint_m(self) -> Floats:
        """World points (15 per part, 2) spread over its footprint, to test whether it fits."""
        grid_u, grid_v = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 3))
        u = grid_u.ravel()
        v = grid_v.ravel()
        spread = [
            (part.ahead_m + u * part.half_length_m, part.left_m + v * part.half_width_m)
            for part in self.parts
        ]
        return self.to_world(np.concatenate(spread, axis=1).T)

    def discs_m(self) -> Floats:
        """x, y and radius (5 per part, 3) of discs that cover its footprint with a margin."""
        discs = []
        for part in self.parts:
            # Five discs in a row along the longer side, somewhat wider than the shorter one.
            short_m, long_m = sorted((part.half_length_m, part.half_width_m))
            offsets_m = np.linspace(-1, 1, 5) * (long_m - short_m)
            is_long_ahead = part.half_length_m >= part.half_width_m
            ahead_m = part.ahead_m + offsets_m * is_long_ahead
            left_m = part.left_m + offsets_m * (not is_long_ahead)
            centres = self.to_world(np.stack([ahead_m, left_m], 1))
            radius_m = 1.15 * short_m + 1.5
            discs.append(np.column_stack([centres, np.full(5, radius_m)]))
        return np.concatenate(discs)

    def half_extent_m(self) -> Floats:
        """How far (2,) its parts reach from its origin, along its length and to its sides."""
        reaches = [
            (abs(part.ahead_m) + part.half_length_m, abs(part.left_m) + part.half_width_m)
            for part in self.parts
        ]
        return np.asarray(np.max(reaches, axis=0))


def boxes(structures: Sequence[Structure], ground: Ground) -> Records:
    """The boxes of all `structures`, each from the height of the ground at its centre."""
    parts = []
    owners = []
    centres = []
    for structure in structures:
        for part in structure.parts:
            parts.append(part)
            owners.append(structure)
            centres.append(structure.to_world(np.array([part.ahead_m, part.left_m])))
    table = columns(parts, "half_length_m", "half_width_m", "bottom_m", "top_m")
    table |= columns(owners, "yaw_rad", "born_day", "dead_day", "kind", "species")
    table["x_m"], table["y_m"] = np.reshape(centres, (-1, 2)).T
    base_m = ground.at(table["x_m"], table["y_m"])
    bottom_m = table["bottom_m"]
    yaw_rad = table.pop("yaw_rad")
    # A part whose bottom is at 0 stands on the ground, and reaches into it.
    table["bottom_m"] = base_m + np.where(bottom_m == 0, -FOOTING_M, bottom_m)
    table["top_m"] += base_m
    return records(
        BOX, cos_yaw=np.cos(yaw_rad), sin_yaw=np.sin(yaw_rad), reflectance=REFLECTANCE, **table
    )
