"""Clutter of a simulated world: things and people that stand beside the streets for one day.

The campus and a day in, shapes for the ray caster out. The campus has spots where something may
stand; on each day some of them are taken, by other things than the day before.
"""

from typing import NamedTuple

import numpy as np

from worlds.layout.campus import Campus
from worlds.layout.shapes import (
    BOX,
    CYLINDER,
    Kind,
    Records,
    Species,
    columns,
    records,
)


class Thing(NamedTuple):
    """One of the things that may stand at a spot."""

    name: str
    share: float
    """Its share of all things."""
    size_m: tuple[float, float, float]
    """Mean half length, half width and height; a person is (radius, radius, height)."""
    species: Species
    """Rays may pass between the PALES of a bicycle or barrier."""


TAKEN_SHARE_BOUNDS = (0.25, 0.55)
"""Bounds of the share of the spots that are taken, which is drawn for each day."""
THINGS = (
    Thing("bin", 0.3, (0.3, 0.3, 1.1), Species.SOLID),
    Thing("boxes", 0.2, (0.55, 0.45, 0.9), Species.SOLID),
    Thing("bicycle", 0.25, (0.85, 0.12, 1.05), Species.PALES),
    Thing("trailer", 0.08, (1.3, 0.7, 1.5), Species.SOLID),
    Thing("barrier", 0.07, (1.2, 0.08, 1.0), Species.PALES),
    Thing("person", 0.1, (0.25, 0.25, 1.7), Species.SOLID),
)
SCALE_BOUNDS = (0.8, 1.25)
"""Bounds of the size of a thing relative to its mean size."""
REFLECTANCE = 0.35
SUNK_M = 0.2
"""How far boxes reach into the ground, so that none hovers over a slope."""


def clutter(rng: np.random.Generator, campus: Campus, day: int) -> tuple[Records, Records]:
    """Draw the boxes of things, and the cylinders of people who stand still, on one day.

    `rng` must be the day's own, so that each day has other things.
    """
    spots = columns(campus.spots, "x_m", "y_m", "yaw_rad", "dead_day")
    x_m = spots["x_m"]
    y_m = spots["y_m"]
    yaw_rad = spots["yaw_rad"]
    spot_count = len(yaw_rad)
    is_open = spots["dead_day"] > day  # dead_day: a construction site closes the spot from then on
    is_taken = (rng.random(spot_count) < rng.uniform(*TAKEN_SHARE_BOUNDS)) & is_open
    thing_rows = rng.choice(len(THINGS), spot_count, p=[thing.share for thing in THINGS])
    size_m = np.array([thing.size_m for thing in THINGS])[thing_rows]
    size_m = size_m * rng.uniform(*SCALE_BOUNDS, (spot_count, 1))
    species = np.array([thing.species for thing in THINGS])[thing_rows]
    is_person = np.array([thing.name == "person" for thing in THINGS])[thing_rows]
    ground_m = campus.ground.at(x_m, y_m)
    has_box = is_taken & ~is_person
    boxes = records(
        BOX,
        x_m=x_m[has_box],
        y_m=y_m[has_box],
        half_length_m=size_m[has_box, 0],
        half_width_m=size_m[has_box, 1],
        cos_yaw=np.cos(yaw_rad[has_box]),
        sin_yaw=np.sin(yaw_rad[has_box]),
        bottom_m=ground_m[has_box] - SUNK_M,
        top_m=ground_m[has_box] + size_m[has_box, 2],
        species=species[has_box],
        kind=Kind.CLUTTER,
        reflectance=REFLECTANCE,
    )
    has_person = is_taken & is_person
    people = records(
        CYLINDER,
        x_m=x_m[has_person],
        y_m=y_m[has_person],
        radius_m=size_m[has_person, 0],
        bottom_m=ground_m[has_person],
        top_m=ground_m[has_person] + size_m[has_person, 2],
        kind=Kind.PERSON,
        reflectance=REFLECTANCE,
    )
    return boxes, people
