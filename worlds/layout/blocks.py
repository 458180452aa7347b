"""Builds a campus: the streets in, everything that stands between and along them out.

The blocks between the streets get a zone each (academic, residential, wood, parking or lawn), and
are filled according to it with buildings, trees, parking slots and clutter. Dense worlds are then
lined with what stands close along their streets (`layout.lining`). Worlds that repeat have rows of
equal buildings along their streets instead (`layout.rows`).
"""

from dataclasses import dataclass, replace

import numpy as np

from worlds import Floats
from worlds.layout.buildings import houses, templates
from worlds.layout.campus import Campus, Pole, Slot
from worlds.layout.furniture import furnish_streets
from worlds.layout.greenery import Plant, tree
from worlds.layout.ground import CELL_M, FINE_CELL_M, banked, rolling_ground
from worlds.layout.lining import Lining, front, line
from worlds.layout.rows import OF_LINING, TREES_PER_BLOCK, build_rows
from worlds.layout.shapes import Kind, Species
from worlds.layout.streets import Streets
from worlds.layout.structures import Part, Structure
from worlds.seeds import Stream, generator

ZONES = {"academic": 0.36, "residential": 0.18, "wood": 0.14, "parking": 0.14, "lawn": 0.18}
"""The share of each zone among random seeds; a block has the zone of its nearest seed, so that
zones are contiguous."""
BLOCKS_PER_ZONE_SEED = 2.2
KERB_M = 9.0
"""Distance from the middle of the streets to the blocks."""

TREE_HEIGHT_BOUNDS_M = (7.0, 16.0)
CONIFER_RADIUS_BOUNDS_M = (2.0, 3.2)
DECIDUOUS_RADIUS_BOUNDS_M = (2.4, 4.6)
TREE_FROM_STREET_M = 2.5
TREE_FROM_BUILDING_M = 2.0
WOOD_M2_PER_TREE = 75.0

ACADEMIC_BUILDINGS = 4
"""Number of buildings in an academic block, if they fit."""
ACADEMIC_TRIES = 80
"""Number of random places at which buildings are tried."""
HOUSE_PITCH_BOUNDS_M = (15.0, 19.0)
"""Bounds of the distance from one house of a residential block to the next."""

PARKING_ROW_M = 17.0
"""Distance from one double row of slots to the next."""
PARKING_SLOT_M = 2.7
"""Distance from one slot to the next."""
PARKING_DEPTH_M = 2.7
"""Distance from the middle of a double row to the middle of a slot."""
PARKING_LAMP_M = 28.0
"""Distance from one lamp to the next."""

CLUTTER_PER_BLOCK = 4.0
"""Mean number of bushes and things."""


@dataclass(frozen=True)
class Block:
    """A rectangle between four corners of the grid, KERB_M from the middle of the streets."""

    centre_m: Floats
    yaw_rad: float
    half_length_m: float
    half_width_m: float
    zone: str
    """One of ZONES."""

    def at(self, ahead_m: float, left_m: float) -> tuple[float, float]:
        """World x, y of a point in the frame of the block, whose origin is its centre."""
        c = np.cos(self.yaw_rad)
        s = np.sin(self.yaw_rad)
        x_m, y_m = self.centre_m
        return float(x_m + c * ahead_m - s * left_m), float(y_m + s * ahead_m + c * left_m)

    def anywhere(self, rng: np.random.Generator, count: int, share: float = 1.0) -> Floats:
        """Random world points (count, 2) in the block, or in the middle `share` of it."""
        places = rng.uniform(-share, share, (count, 2)) * (self.half_length_m, self.half_width_m)
        return np.reshape([self.at(ahead_m, left_m) for ahead_m, left_m in places], (-1, 2))


def build_campus(seed: int, blocks: int, streets: Streets, lining: Lining = "sparse") -> Campus:
    """Build the campus around the `streets` of blocks × blocks blocks, as on the training day.

    With the lining `street`, blocks hold nothing but the lots along the streets; with `terraces`
    and `colonnade` nothing but rows along them and a few trees, and the ground is flat.
    """
    is_dense = lining in ("street", "campus")
    ground = rolling_ground(
        generator(seed, Stream.GROUND),
        streets.nodes_m.min(0),
        streets.nodes_m.max(0),
        FINE_CELL_M if is_dense else CELL_M,
    )
    rng = generator(seed, Stream.BLOCKS)
    lining_rng = generator(seed, Stream.LINING)
    campus = Campus(streets, ground, templates(rng))
    if lining in OF_LINING:
        campus.ground = replace(ground, heights_m=np.zeros_like(ground.heights_m))
        build_rows(campus, lining)
        for block in divide(rng, streets, blocks):
            _trees(rng, block, campus, TREES_PER_BLOCK, conifer_share=0.2)
        furnish_streets(generator(seed, Stream.FURNITURE), campus, has_avenues=False)
        return campus
    if is_dense:
        campus.ground = banked(lining_rng, ground, streets)
        campus.fronts = {
            template: front(lining_rng, template) for template in [*campus.templates, *houses()]
        }
    if lining != "street":
        for block in divide(rng, streets, blocks):
            fill(rng, block, campus)
        furnish_streets(generator(seed, Stream.FURNITURE), campus)
    if is_dense:
        line(lining_rng, campus, lining)
    return campus


def divide(rng: np.random.Generator, streets: Streets, blocks: int) -> list[Block]:
    """Divide the grid into its blocks × blocks blocks, each with a zone."""
    corners_m = streets.nodes_m[: (blocks + 1) ** 2].reshape(blocks + 1, blocks + 1, 2)
    low_m = corners_m.min((0, 1))
    high_m = corners_m.max((0, 1))
    n_seeds = max(1, int((blocks + 1) ** 2 / BLOCKS_PER_ZONE_SEED))
    seeds_m = rng.uniform(low_m, high_m, (n_seeds, 2))
    zones = rng.choice(list(ZONES), len(seeds_m), p=list(ZONES.values()))
    grid_blocks = []
    for i in range(blocks):
        for j in range(blocks):
            (sw, nw), (se, ne) = corners_m[i : i + 2, j : j + 2]
            centre_m = (sw + se + ne + nw) / 4
            half_length_m = (np.hypot(*(se - sw)) + np.hypot(*(ne - nw))) / 4 - KERB_M
            half_width_m = (np.hypot(*(nw - sw)) + np.hypot(*(ne - se))) / 4 - KERB_M
            east_m, north_m = se - sw
            yaw_rad = float(np.arctan2(north_m, east_m))
            zone = str(zones[((seeds_m - centre_m) ** 2).sum(1).argmin()])
            grid_blocks.append(Block(centre_m, yaw_rad, half_length_m, half_width_m, zone))
    return grid_blocks


def fill(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Build and plant a block according to its zone, then scatter bushes and street clutter."""
    if block.zone == "academic":
        _academic(rng, block, campus)
    elif block.zone == "residential":
        _residential(rng, block, campus)
    elif block.zone == "parking":
        _parking(block, campus)
    count, conifer_share = _tree_count(rng, block)
    _trees(rng, block, campus, count, conifer_share)
    _clutter(rng, block, campus)


def _academic(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Large buildings at random places, about in line with the block."""
    n_built = 0
    for _ in range(ACADEMIC_TRIES):
        x_m, y_m = block.anywhere(rng, 1, 0.8)[0].tolist()
        turn_rad = rng.choice([0, 0, 0, np.pi / 2, np.pi, -np.pi / 2]) + rng.normal(0, 0.02)
        template = campus.templates[rng.integers(len(campus.templates))]
        building = Structure(x_m, y_m, block.yaw_rad + turn_rad, template)
        if campus.fits(building):
            campus.build(building)
            n_built += 1
        if n_built == ACADEMIC_BUILDINGS:
            return


def _residential(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Two regular rows of one type of house, half of them with a hedge towards the next."""
    template = houses()[rng.integers(2)]
    pitch_m = rng.uniform(*HOUSE_PITCH_BOUNDS_M)
    for left_m in (9 - block.half_width_m, block.half_width_m - 9):
        for ahead_m in np.arange(8 - block.half_length_m, block.half_length_m - 6, pitch_m):
            house = Structure(*block.at(ahead_m, left_m), block.yaw_rad, template)
            if not campus.fits(house):
                continue
            campus.build(house)
            place = block.at(ahead_m + pitch_m / 2, left_m)
            if rng.random() < 0.5 and campus.is_free(np.array([place]), 4.5, 0.0)[0]:
                hedge = (Part(0, 0, 0.5, 4.0, 0, 1.6),)
                campus.structures.append(
                    Structure(*place, block.yaw_rad, hedge, Kind.LEAF, Species.HEDGE)
                )


def _parking(block: Block, campus: Campus) -> None:
    """Double rows of slots, back to back, with lamps between the backs."""
    for row_m in np.arange(8 - block.half_width_m, block.half_width_m - 6, PARKING_ROW_M):
        for ahead_m in np.arange(4 - block.half_length_m, block.half_length_m - 3, PARKING_SLOT_M):
            for depth_m in (-PARKING_DEPTH_M, PARKING_DEPTH_M):
                place = block.at(ahead_m, row_m + depth_m)
                if campus.is_free(np.array([place]), 2.5, 1.0)[0]:
                    campus.slots.append(Slot(*place, block.yaw_rad + np.pi / 2))
        for ahead_m in np.arange(8 - block.half_length_m, block.half_length_m - 5, PARKING_LAMP_M):
            place = block.at(ahead_m, row_m)
            if campus.is_free(np.array([place]), 0.5, 0.5)[0]:
                campus.poles.append(Pole(*place, radius_m=0.12, height_m=8.0))


def _tree_count(rng: np.random.Generator, block: Block) -> tuple[int, float]:
    """The random number of trees in a block of its zone, and the share of conifers among them."""
    if block.zone == "academic":
        return int(rng.integers(6, 16)), 0.2
    if block.zone == "residential":
        return int(rng.integers(8, 18)), 0.3
    if block.zone == "wood":
        area_m2 = 4 * block.half_length_m * block.half_width_m
        return int(area_m2 / WOOD_M2_PER_TREE), float(rng.choice([0.1, 0.6]))
    if block.zone == "parking":
        return int(rng.integers(2, 7) / 2), 0.0
    return int(rng.integers(1, 9)), 0.2


def _trees(
    rng: np.random.Generator, block: Block, campus: Campus, count: int, conifer_share: float
) -> None:
    """Trees at those of `count` random places that are free."""
    places_m = block.anywhere(rng, count)
    is_free = campus.is_free(places_m, TREE_FROM_STREET_M, TREE_FROM_BUILDING_M)
    for x_m, y_m in places_m[is_free].tolist():
        is_conifer = rng.random() < conifer_share
        if is_conifer:
            radius_m = rng.uniform(*CONIFER_RADIUS_BOUNDS_M)
            species = Species.CONIFER
        else:
            radius_m = rng.uniform(*DECIDUOUS_RADIUS_BOUNDS_M)
            species = Species.DECIDUOUS
        height_m = rng.uniform(*TREE_HEIGHT_BOUNDS_M)
        campus.plants.append(tree(rng, x_m, y_m, height_m, radius_m, species))


def _clutter(rng: np.random.Generator, block: Block, campus: Campus) -> None:
    """Bushes, and things such as bins, at random free places."""
    places_m = block.anywhere(rng, rng.poisson(CLUTTER_PER_BLOCK))
    for x_m, y_m in places_m[campus.is_free(places_m, 2.0, 0.0)].tolist():
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
