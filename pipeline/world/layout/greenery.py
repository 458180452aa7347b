"""Trees and bushes: a solid trunk and a porous crown, whose density follows the season."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import ALWAYS, CROWN, CYLINDER, Kind, Records, Species, records

TRUNK_REFLECTANCE, LEAF_REFLECTANCE = 0.3, 0.4
TRUNK_RADIUS_M, TRUNK_RADIUS_PER_HEIGHT = 0.12, 0.012
TRUNK_IN_CROWN = 0.3
"""The share of the height of the crown that the trunk reaches into."""
ROOT_M = 1.0
CONIFER_TRUNK_SHARE, DECIDUOUS_TRUNK_SHARES = 0.12, (0.28, 0.36)


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


def tree(rng: np.random.Generator, x_m: float, y_m: float, height_m: float, radius_m: float, species: Species) -> Plant:
    """A tree; the height of its trunk is a share of its own height that depends on the species."""
    share = CONIFER_TRUNK_SHARE if species == Species.CONIFER else rng.uniform(*DECIDUOUS_TRUNK_SHARES)
    return Plant(x_m, y_m, height_m, height_m * share, radius_m, species)


def crowns(plants: Sequence[Plant], ground: Ground) -> Records:
    """The ellipsoid crowns of `plants`; `simulate_day` sets their extinction, here 0."""
    columns = _columns(plants)
    height_m, trunk_m = columns.pop("height_m"), columns.pop("trunk_m")
    middle_m = _base_m(columns, ground) + (height_m + trunk_m) / 2
    return records(
        CROWN, z_m=middle_m, half_height_m=(height_m - trunk_m) / 2, reflectance=LEAF_REFLECTANCE, kind=Kind.LEAF, **columns
    )


def trunks(plants: Sequence[Plant], ground: Ground) -> Records:
    """The cylindrical trunks of the trees among `plants`."""
    columns = _columns([plant for plant in plants if plant.trunk_m > 0])
    height_m, trunk_m = columns.pop("height_m"), columns.pop("trunk_m")
    columns["radius_m"] = TRUNK_RADIUS_M + TRUNK_RADIUS_PER_HEIGHT * height_m
    columns["species"] = np.full(len(height_m), Species.SOLID)
    base_m = _base_m(columns, ground)
    top_m = base_m + trunk_m + TRUNK_IN_CROWN * (height_m - trunk_m)
    return records(CYLINDER, bottom_m=base_m - ROOT_M, top_m=top_m, reflectance=TRUNK_REFLECTANCE, kind=Kind.TRUNK, **columns)


def _columns(plants: Sequence[Plant]) -> dict[str, np.ndarray]:
    names = ("x_m", "y_m", "height_m", "trunk_m", "radius_m", "species", "born_day", "dead_day")
    return {name: np.array([getattr(plant, name) for plant in plants], float) for name in names}


def _base_m(columns: dict[str, np.ndarray], ground: Ground) -> np.ndarray:
    return ground.at(np.stack([columns["x_m"], columns["y_m"]], 1))
