"""Trees and bushes: a solid trunk and a porous crown, whose density follows the season."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import (
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
TRUNK_IN_CROWN = 0.3
"""The share of the height of the crown that the trunk reaches into."""
ROOT_M = 1.0
CONIFER_TRUNK_SHARE = 0.12
DECIDUOUS_TRUNK_SHARES = (0.28, 0.36)


@dataclass(frozen=True)
class Plant:
    """A tree, or a bush where `trunk_m` is 0."""

    x_m: float
    y_m: float
    height_m: float
    trunk_m: float
    """Height of the lower end of the crown above the ground."""
    radius_m: float
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
    """A tree; the height of its trunk is a share of its own height that depends on the species."""
    share = (
        CONIFER_TRUNK_SHARE if species == Species.CONIFER else rng.uniform(*DECIDUOUS_TRUNK_SHARES)
    )
    return Plant(x_m, y_m, height_m, height_m * share, radius_m, species)


def crowns(plants: Sequence[Plant], ground: Ground) -> Records:
    """The ellipsoid crowns of `plants`; `simulate_day` sets their extinction, here 0."""
    table = columns(plants, "x_m", "y_m", "radius_m", "species", "born_day", "dead_day")
    height_m, trunk_m = columns(plants, "height_m", "trunk_m").values()
    z_m = ground.at(table["x_m"], table["y_m"]) + (height_m + trunk_m) / 2
    half_height_m = (height_m - trunk_m) / 2
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
    height_m, trunk_m = columns(trees, "height_m", "trunk_m").values()
    table["bottom_m"] = (base_m := ground.at(table["x_m"], table["y_m"])) - ROOT_M
    table["top_m"] = base_m + trunk_m + TRUNK_IN_CROWN * (height_m - trunk_m)
    radius_m = TRUNK_RADIUS_M + TRUNK_RADIUS_PER_HEIGHT * height_m
    return records(
        CYLINDER, radius_m=radius_m, reflectance=TRUNK_REFLECTANCE, kind=Kind.TRUNK, **table
    )
