"""Clutter that comes and goes: on each day other things stand at the spots beside the streets."""

import numpy as np

from pipeline.world.layout.campus import Campus
from pipeline.world.layout.shapes import (
    BOX,
    CYLINDER,
    Kind,
    Records,
    Species,
    columns,
    records,
)

TAKEN_SHARES = (0.25, 0.55)
"""The share of the spots where something stands, drawn anew for each day."""
THINGS = (
    ("bin", 0.3, (0.3, 0.3, 1.1), Species.SOLID),
    ("boxes", 0.2, (0.55, 0.45, 0.9), Species.SOLID),
    ("bicycle", 0.25, (0.85, 0.12, 1.05), Species.PALES),
    ("trailer", 0.08, (1.3, 0.7, 1.5), Species.SOLID),
    ("barrier", 0.07, (1.2, 0.08, 1.0), Species.PALES),
    ("person", 0.1, (0.25, 0.25, 1.7), Species.SOLID),
)
"""Name, share, and half length, half width and height in metres."""
SCALES = (0.8, 1.25)
REFLECTANCE = 0.35


def clutter(rng: np.random.Generator, campus: Campus, day: int) -> tuple[Records, Records]:
    """Boxes of things, and cylinders of people who stand still, on one day."""
    x_m, y_m, yaw, dead_day = columns(campus.spots, "x_m", "y_m", "yaw_rad", "dead_day").values()
    count = len(yaw)
    is_taken = (rng.random(count) < rng.uniform(*TAKEN_SHARES)) & (dead_day > day)
    thing = rng.choice(len(THINGS), count, p=[share for _, share, _, _ in THINGS])
    size_m = np.array([size for _, _, size, _ in THINGS])[thing]
    size_m = size_m * rng.uniform(*SCALES, (count, 1))
    species = np.array([species for _, _, _, species in THINGS])[thing]
    is_person = np.array([name == "person" for name, _, _, _ in THINGS])[thing]
    base_m = campus.ground.at(x_m, y_m)
    boxed = is_taken & ~is_person
    boxes = records(
        BOX,
        x_m=x_m[boxed],
        y_m=y_m[boxed],
        half_length_m=size_m[boxed, 0],
        half_width_m=size_m[boxed, 1],
        cos_yaw=np.cos(yaw[boxed]),
        sin_yaw=np.sin(yaw[boxed]),
        bottom_m=base_m[boxed] - 0.2,
        top_m=base_m[boxed] + size_m[boxed, 2],
        species=species[boxed],
        **_surface(Kind.CLUTTER),
    )
    stood = is_taken & is_person
    people = records(
        CYLINDER,
        x_m=x_m[stood],
        y_m=y_m[stood],
        radius_m=size_m[stood, 0],
        bottom_m=base_m[stood],
        top_m=base_m[stood] + size_m[stood, 2],
        **_surface(Kind.PERSON),
    )
    return boxes, people


def _surface(kind: Kind) -> dict[str, float]:
    return {"kind": kind, "reflectance": REFLECTANCE}
