"""Builds a campus: fills the blocks between the streets with buildings, trees and cars.

What a block holds depends on its zone.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.world import Floats
from pipeline.world.layout.buildings import houses, templates
from pipeline.world.layout.campus import Campus, Pole, Slot
from pipeline.world.layout.furniture import furnish_streets
from pipeline.world.layout.greenery import Plant, tree
from pipeline.world.layout.ground import CELL_M, FINE_CELL_M, banked, rolling_ground
from pipeline.world.layout.lining import Lining, front, line
from pipeline.world.layout.shapes import Kind, Species
from pipeline.world.layout.streets import Streets
from pipeline.world.layout.structures import Part, Structure
from pipeline.world.seeds import Stream, generator

ZONES = {"academic": 0.36, "residential": 0.18, "wood": 0.14, "parking": 0.14, "lawn": 0.18}
"""The share of each zone among random seeds; a block has the zone of its nearest seed, which makes
zones contiguous."""
BLOCKS_PER_ZONE_SEED = 2.2

KERB_M = 9.0
TREE_HEIGHTS_M = (7.0, 16.0)
CONIFER_RADII_M = (2.0, 3.2)
DECIDUOUS_RADII_M = (2.4, 4.6)
TREE_FROM_STREET_M = 2.5
TREE_FROM_BUILDING_M = 2.0
ACADEMIC_BUILDINGS = 4
ACADEMIC_TRIES = 80
HOUSE_PITCHES_M = (15.0, 19.0)
WOOD_M2_PER_TREE = 75.0
PARKING_ROW_M = 17.0
PARKING_SLOT_M = 2.7
PARKING_DEPTH_M = 2.7
PARKING_LAMP_M = 28.0
CLUTTER_PER_BLOCK = 4.0


@dataclass(frozen=True)
class Block:
    """The rectangle inside four corners, KERB_M from the middle of the streets."""

    centre_m: Floats
    yaw_rad: float
    half_length_m: float
    half_width_m: float
    zone: str

    def at(self, ahead_m: float, left_m: float) -> tuple[float, float]:
        """World x, y of a point in the block's frame."""
        c = np.cos(self.yaw_rad)
        s = np.sin(self.yaw_rad)
        x_m, y_m = self.centre_m
        return float(x_m + c * ahead_m - s * left_m), float(y_m + s * ahead_m + c * left_m)

    def anywhere(self, rng: np.random.Generator, count: int, share: float = 1.0) -> Floats:
        """Random points (count, 2) of the block, or of its middle `share`."""
        spread = rng.uniform(-share, share, (count, 2))
        return np.reshape(
            [self.at(u * self.half_length_m, v * self.half_width_m) for u, v in spread], (-1, 2)
        )


def build_campus(seed: int, blocks: int, streets: Streets, lining: Lining = "sparse") -> Campus:
    """The campus around `streets`, as it stands on the training day.

    Lined as a `street` its blocks hold nothing but the lots along the streets.
    """
    dense = lining != "sparse"
    ground = rolling_ground(
        generator(seed, Stream.GROUND),
        streets.nodes_m.min(0),
        streets.nodes_m.max(0),
        FINE_CELL_M if dense else CELL_M,
    )
    rng = generator(seed, Stream.BLOCKS)
    lining_rng = generator(seed, Stream.LINING)
    campus = Campus(streets, ground, templates(rng))
    if dense:
        campus.ground = banked(lining_rng, ground, streets)
        campus.fronts = {
            recipe: front(lining_rng, recipe) for recipe in [*campus.recipes, *houses()]
        }
    if lining != "street":
        for block in divide(rng, streets, blocks):
            fill(rng, block, campus)
        furnish_streets(generator(seed, Stream.FURNITURE), campus)
    if dense:
        line(lining_rng, campus, lining)
    return campus


def divide(rng: np.random.Generator, streets: Streets, blocks: int) -> list[Block]:
    """The blocks × blocks blocks of the grid, each with a zone."""
    corners_m = streets.nodes_m[: (blocks + 1) ** 2].reshape(blocks + 1, blocks + 1, 2)
    low_m = corners_m.min((0, 1))
    high_m = corners_m.max((0, 1))
    seeds_m = rng.uniform(low_m, high_m, (max(1, int((blocks + 1) ** 2 / BLOCKS_PER_ZONE_SEED)), 2))
    zones = rng.choice(list(ZONES), len(seeds_m), p=list(ZONES.values()))
    grid_blocks = []
    for i in range(blocks):
        for j in range(blocks):
            (sw, nw), (se, ne) = corners_m[i : i + 2, j : j + 2]
            centre = (sw + se + ne + nw) / 4
            half_length_m = (np.hypot(*(se - sw)) + np.hypot(*(ne - nw))) / 4 - KERB_M
            half_width_m = (np.hypot(*(nw - sw)) + np.hypot(*(ne - se))) / 4 - KERB_M
            yaw = float(np.arctan2(*(se - sw)[::-1]))
            zone = str(zones[((seeds_m - centre) ** 2).sum(1).argmin()])
            grid_blocks.append(Block(centre, yaw, half_length_m, half_width_m, zone))
    return grid_blocks


def fill(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Build and plant a block according to its zone, then scatter bushes and street clutter."""
    if block.zone == "academic":
        _academic(rng, block, campus)
    elif block.zone == "residential":
        _residential(rng, block, campus)
    elif block.zone == "parking":
        _parking(block, campus)
    trees, conifer_share = _TREES[block.zone](rng, block)
    _trees(rng, block, campus, int(trees), conifer_share)
    _clutter(rng, block, campus)


_TREES: dict[str, Callable[[np.random.Generator, Block], tuple[float, float]]] = {
    "academic": lambda rng, block: (float(rng.integers(6, 16)), 0.2),
    "residential": lambda rng, block: (float(rng.integers(8, 18)), 0.3),
    "wood": lambda rng, block: (
        4 * block.half_length_m * block.half_width_m / WOOD_M2_PER_TREE,
        rng.choice([0.1, 0.6]),
    ),
    "parking": lambda rng, block: (rng.integers(2, 7) / 2, 0.0),
    "lawn": lambda rng, block: (float(rng.integers(1, 9)), 0.2),
}
"""Number of trees in a block of each zone, and the share of conifers."""


def _academic(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    built = 0
    for _ in range(ACADEMIC_TRIES):
        x_m, y_m = block.anywhere(rng, 1, 0.8)[0].tolist()
        turn = rng.choice([0, 0, 0, np.pi / 2, np.pi, -np.pi / 2]) + rng.normal(0, 0.02)
        building = Structure(
            x_m, y_m, block.yaw_rad + turn, campus.recipes[rng.integers(len(campus.recipes))]
        )
        if campus.fits(building):
            campus.build(building)
            built += 1
        if built == ACADEMIC_BUILDINGS:
            return


def _residential(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Two regular rows of one type of house, half of them with a hedge to the next."""
    recipe = houses()[rng.integers(2)]
    pitch_m = rng.uniform(*HOUSE_PITCHES_M)
    for left_m in (9 - block.half_width_m, block.half_width_m - 9):
        for ahead_m in np.arange(8 - block.half_length_m, block.half_length_m - 6, pitch_m):
            house = Structure(*block.at(ahead_m, left_m), block.yaw_rad, recipe)
            if not campus.fits(house):
                continue
            campus.build(house)
            place = block.at(ahead_m + pitch_m / 2, left_m)
            if rng.random() < 0.5 and campus.free(np.array([place]), 4.5, 0.0)[0]:
                hedge = (Part(0, 0, 0.5, 4.0, 0, 1.6),)
                campus.structures.append(
                    Structure(*place, block.yaw_rad, hedge, Kind.LEAF, Species.HEDGE)
                )


def _parking(block: Block, campus: Campus) -> None:
    """Rows of slots, back to back, with lamps between the backs."""
    for row_m in np.arange(8 - block.half_width_m, block.half_width_m - 6, PARKING_ROW_M):
        for ahead_m in np.arange(4 - block.half_length_m, block.half_length_m - 3, PARKING_SLOT_M):
            for depth_m in (-PARKING_DEPTH_M, PARKING_DEPTH_M):
                place = block.at(ahead_m, row_m + depth_m)
                if campus.free(np.array([place]), 2.5, 1.0)[0]:
                    campus.slots.append(Slot(*place, block.yaw_rad + np.pi / 2))
        for ahead_m in np.arange(8 - block.half_length_m, block.half_length_m - 5, PARKING_LAMP_M):
            place = block.at(ahead_m, row_m)
            if campus.free(np.array([place]), 0.5, 0.5)[0]:
                campus.poles.append(Pole(*place, radius_m=0.12, height_m=8.0))


def _trees(
    rng: np.random.Generator, block: Block, campus: Campus, count: int, conifer_share: float
) -> None:
    places_m = block.anywhere(rng, count)
    for x_m, y_m in places_m[
        campus.free(places_m, TREE_FROM_STREET_M, TREE_FROM_BUILDING_M)
    ].tolist():
        conifer = rng.random() < conifer_share
        radius_m = rng.uniform(*(CONIFER_RADII_M if conifer else DECIDUOUS_RADII_M))
        species = Species.CONIFER if conifer else Species.DECIDUOUS
        campus.plants.append(tree(rng, x_m, y_m, rng.uniform(*TREE_HEIGHTS_M), radius_m, species))


def _clutter(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    places_m = block.anywhere(rng, rng.poisson(CLUTTER_PER_BLOCK))
    for x_m, y_m in places_m[campus.free(places_m, 2.0, 0.0)].tolist():
        if rng.random() < 0.6:
            height_m = 0.6 + rng.uniform(0.7, 1.2)
            campus.plants.append(
                Plant(x_m, y_m, height_m, 0.0, rng.uniform(0.8, 1.8), Species.HEDGE)
            )
        else:
            thing = (
                Part(0, 0, rng.uniform(0.4, 1.5), rng.uniform(0.3, 1.0), 0, rng.uniform(0.8, 2.4)),
            )
            campus.structures.append(Structure(x_m, y_m, block.yaw_rad, thing, Kind.CLUTTER))
