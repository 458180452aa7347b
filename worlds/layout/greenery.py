"""Trees and bushes, and their shapes for the ray caster: a solid trunk and a porous crown, whose
density follows the season.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from worlds.layout.ground import Ground
from worlds.layout.shapes import (
    ALWAYS,
    CROWN,
    CYLINDER,
    Kind,
    Records,
    Species,
    columns,
    records,
)

TRUNK_REFLECTANCE = 0.3
LEAF_REFLECTANCE = 0.4
TRUNK_RADIUS_M = 0.12
TRUNK_RADIUS_PER_HEIGHT = 0.012
"""The radius of a trunk is TRUNK_RADIUS_M and this share of the tree's height."""
TRUNK_IN_CROWN = 0.3
"""How far the trunk reaches into the crown, as a share of the crown's height."""
ROOT_M = 1.0
"""How far the trunk reaches into the ground, so that there is no gap on slopes."""
CONIFER_TRUNK_SHARE = 0.12
"""Height of the crown's lower end, as a share of the tree's height."""
DECIDUOUS_TRUNK_SHARE_BOUNDS = (0.28, 0.36)
"""Bounds of this share for a deciduous tree."""


@dataclass(frozen=True)
class Plant:
    """A tree, or a bush if `trunk_m` is 0."""

    x_m: float
    y_m: float
    height_m: float
    trunk_m: float
    """Height of the lower end of the crown above the ground."""
    radius_m: float
    """Radius of the crown."""
    species: Species
    born_day: float = ALWAYS[0]
    dead_day: float = ALWAYS[1]


def tree(
    rng: np.random.Generator,
    x_m: float,
    y_m: float,
    height_m: float,
    radius_m: float,
    species: Species,
) -> Plant:
    """A tree, whose crown begins at a height that depends on its species."""
    trunk_share = CONIFER_TRUNK_SHARE
    if species != Species.CONIFER:
        trunk_share = rng.uniform(*DECIDUOUS_TRUNK_SHARE_BOUNDS)
    return Plant(x_m, y_m, height_m, height_m * trunk_share, radius_m, species)


def crowns(plants: Sequence[Plant], ground: Ground) -> Records:
    """The ellipsoid crowns of `plants`; their extinction is 0 until `simulate_day` sets it."""
    table = columns(plants, "x_m", "y_m", "radius_m", "species", "born_day", "dead_day")
    sizes = columns(plants, "height_m", "trunk_m")
    middle_m = (sizes["height_m"] + sizes["trunk_m"]) / 2
    z_m = ground.at(table["x_m"], table["y_m"]) + middle_m
    half_height_m = (sizes["height_m"] - sizes["trunk_m"]) / 2
    return records(
        CROWN,
        z_m=z_m,
        half_height_m=half_height_m,
        reflectance=LEAF_REFLECTANCE,
        kind=Kind.LEAF,
        **table,
    )


def trunks(plants: Sequence[Plant], ground: Ground) -> Records:
    """The cylindrical trunks of the trees among `plants`."""
    trees = [plant for plant in plants if plant.trunk_m > 0]
    table = columns(trees, "x_m", "y_m", "born_day", "dead_day")
    sizes = columns(trees, "height_m", "trunk_m")
    height_m = sizes["height_m"]
    trunk_m = sizes["trunk_m"]
    base_m = ground.at(table["x_m"], table["y_m"])
    table["bottom_m"] = base_m - ROOT_M
    table["top_m"] = base_m + trunk_m + TRUNK_IN_CROWN * (height_m - trunk_m)
    radius_m = TRUNK_RADIUS_M + TRUNK_RADIUS_PER_HEIGHT * height_m
    return records(
        CYLINDER, radius_m=radius_m, reflectance=TRUNK_REFLECTANCE, kind=Kind.TRUNK, **table
    )
