"""Structures of boxes: buildings, houses, hedges, fences; the same parts may stand in many places."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import ALWAYS, BOX, Kind, Records, Species, records

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

    def to_world(self, ahead_left_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points (..., 2) in metres of points in the frame of the structure."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.asarray(ahead_left_m @ np.array([[c, s], [-s, c]]) + (self.x_m, self.y_m))

    def outline_m(self) -> NDArray[np.float64]:
        """World points (15 per part, 2) spread over its footprint, to test whether it fits."""
        u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 3)))
        spread = [
            np.stack([part.ahead_m + u * part.half_length_m, part.left_m + v * part.half_width_m], 1) for part in self.parts
        ]
        return self.to_world(np.concatenate(spread))

    def discs_m(self) -> NDArray[np.float64]:
        """Discs (5 per part, 3) of x, y, radius that cover its footprint, to keep others at a distance."""
        discs = []
        for part in self.parts:
            along_x = part.half_length_m >= part.half_width_m
            short_m, long_m = sorted((part.half_length_m, part.half_width_m))
            reach_m = np.linspace(-1, 1, 5) * (long_m - short_m)
            centres = np.stack([part.ahead_m + reach_m * along_x, part.left_m + reach_m * (not along_x)], 1)
            discs.append(np.column_stack([self.to_world(centres), np.full(5, 1.15 * short_m + 1.5)]))
        return np.concatenate(discs)

    def half_extent_m(self) -> tuple[float, float]:
        """The largest distance of its parts from its own origin, along its length and to its sides."""
        ahead = max(abs(part.ahead_m) + part.half_length_m for part in self.parts)
        return ahead, max(abs(part.left_m) + part.half_width_m for part in self.parts)


def boxes(structures: Sequence[Structure], ground: Ground) -> Records:
    """The boxes of all `structures`; the base of each part is the height of the ground at its centre."""
    if not structures:
        return np.zeros(0, BOX)
    owners = [structure for structure in structures for _ in structure.parts]
    parts = [part for structure in structures for part in structure.parts]
    places = zip(owners, parts, strict=True)
    centres = np.array([owner.to_world(np.array([part.ahead_m, part.left_m])) for owner, part in places])
    base_m = ground.at(centres)
    yaw = np.array([owner.yaw_rad for owner in owners])
    bottom_m = np.array([part.bottom_m for part in parts])
    return records(
        BOX,
        x_m=centres[:, 0],
        y_m=centres[:, 1],
        **{name: [getattr(part, name) for part in parts] for name in ("half_length_m", "half_width_m")},
        cos_yaw=np.cos(yaw),
        sin_yaw=np.sin(yaw),
        bottom_m=base_m + np.where(bottom_m == 0, -FOOTING_M, bottom_m),
        top_m=base_m + [part.top_m for part in parts],
        reflectance=REFLECTANCE,
        **{name: [getattr(owner, name) for owner in owners] for name in ("born_day", "dead_day", "kind", "species")},
    )
