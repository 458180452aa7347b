"""Lines the streets of a dense world with what stands close to them, 0.3 to 5 m above the ground.

A dense world is lined in one of two ways (`Lining`). A `street` is narrow, with houses, gardens
and parked cars on both sides, as in an old suburb. A `campus` keeps its blocks, and gets hedges,
low walls and bushes beside its ways and at the feet of its buildings.

All shares, pitches and sizes below were set so that scans and views are about as full as recorded
ones (docs/notes/worlds.md), never by the score of a method.

A box is written `Part(x, y, half length along x, half width along y, bottom, top)`, in metres: its
centre in the frame of its lot or building, and its heights above the ground.
"""

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from worlds.layout.buildings import Template
from worlds.layout.campus import Campus, Pole, Slot
from worlds.layout.greenery import Plant, tree
from worlds.layout.shapes import Kind, Species
from worlds.layout.structures import Part, Structure

Lining: TypeAlias = Literal["sparse", "street", "campus", "terraces", "colonnade"]
"""How streets are lined; `sparse` is a world that is not dense, whose streets are not lined.
`terraces` and `colonnade` are worlds that repeat (`layout.rows`), not dense either."""

# The lots of a street, from its border outwards.
PAVEMENT_BOUNDS_M = (1.5, 2.6)
"""Width of the pavement."""
FRONT_GARDEN_BOUNDS_M = (1.0, 8.0)
"""Depth of the gardens between the pavement and the houses, the same for a whole row."""
HOUSE_LENGTH_BOUNDS_M = (9.0, 15.0)
"""Length of a house along the street."""
TERRACED_SHARE = 0.3
"""Share of the rows without gaps between the houses."""
SIDE_GAP_BOUNDS_M = (4.0, 9.0)
"""Gap between detached houses."""
EMPTY_LOT_SHARE = 0.25
"""Share of the lots without a house."""
EAVES_BOUNDS_M = (4.8, 7.2)
"""Height of a house without its roof."""
HOUSE_HALF_DEPTH_BOUNDS_M = (4.2, 6.0)
HOUSE_FROM_STREET_M = 1.2
"""Least distance between a house and the border of any street."""
FROM_CORNER_M = 7.0
"""How far from its ends a street is lined."""
BACK_GARDEN_BOUNDS_M = (6.0, 13.0)
"""Depth of the gardens behind the houses."""
GARAGE_SHARE = 0.5
"""Share of the lots with enough room that have a garage."""
DRIVE_M = 5.4
"""Least distance of a garage from the street: a car before it stays off the street."""
SHED_SHARE = 0.6
"""Share of the lots with a shed."""

# Borders of lots, and what grows in gardens.
BORDERS = ("hedge", "wall", "fence", "open")
BORDER_SHARES = (0.35, 0.2, 0.2, 0.25)
"""The shares of the four kinds of border."""
HEDGE_HEIGHT_BOUNDS_M = (0.6, 1.5)
HEDGE_HALF_WIDTH_BOUNDS_M = (0.35, 0.7)
WALL_HEIGHT_BOUNDS_M = (0.4, 1.2)
FENCE_HEIGHT_BOUNDS_M = (0.8, 1.4)
PIECE_M = 4.0
"""Approximate length of a piece of a kerb, hedge, wall or fence. The top of a piece is level."""
BUSHES_PER_M2 = 0.07
BUSH_RADIUS_BOUNDS_M = (0.4, 1.1)
BUSH_HEIGHT_BOUNDS_M = (0.4, 1.6)
TREES_PER_LOT = 1.2
GARDEN_TREE_HEIGHT_BOUNDS_M = (4.0, 9.0)
GARDEN_TREE_RADIUS_BOUNDS_M = (1.2, 3.0)
CONIFER_SHARE = 0.3
"""Share of the garden trees that are conifers."""
UNDERGROWTH_SHARE = 0.2
"""Share of the trees with a bush under them."""

# Kerbs, and places beside streets.
KERB_HEIGHT_M = 0.12
KERB_ROW_SHARE = 0.6
"""Share of the roadsides where cars may park."""
KERB_SLOT_M = 5.8
"""Distance from one slot at the kerb to the next."""
LAMP_M = 28.0
"""Distance from one lamp to the next."""
SPOT_M = 6.0
"""Distance along a street between places where clutter may stand on some days."""
CLEAR_OF_STREET_M = 0.3
"""Least distance of bushes and lamps from the border of any street; structures keep half of it."""
TREE_FROM_STREET_M = 1.0
SPOT_FROM_STREET_M = 0.8

# The waysides of a campus, and the feet of its buildings.
PIECE_BOUNDS_M = (4.0, 8.0)
"""Length of a piece of a wayside."""
BARE_PIECE_SHARE = 0.75
"""Share of these pieces with nothing beside the way."""
BESIDE_BOUNDS_M = (2.0, 12.0)
"""Distance of what stands there from the border of the way."""
FOOT_PITCH_M = 2.2
"""Distance between the places for bushes along a building."""
FOOT_SHARE = 0.2
"""Share of these places that have a bush."""


@dataclass(frozen=True)
class Side:
    """One side of a street.

    Stations are distances along the street from its start, on both sides. Structures have the frame
    of the side: y points away from the street, so x points along the street on its left side, and
    against it on its right side.
    """

    campus: Campus
    street: int
    """Number of the street."""
    sign: int
    """1 for its left side, −1 for its right side."""

    @property
    def length_m(self) -> float:
        """Length of the street."""
        return float(self.campus.streets.lengths_m[self.street])

    @property
    def yaw_rad(self) -> float:
        """The heading of the x axis, such that the y axis points away from the street."""
        along, _ = self.campus.streets.directions()
        along_x, along_y = along[self.street]
        turn_rad = 0.0 if self.sign > 0 else np.pi
        return float(np.arctan2(along_y, along_x)) + turn_rad

    def at(self, station_m: float, off_m: float) -> tuple[float, float]:
        """World x, y of a place `station_m` along the street, `off_m` away from its border."""
        streets = self.campus.streets
        left_m = self.sign * (streets.half_widths_m[self.street] + off_m)
        x_m, y_m = streets.beside(self.street, np.array([station_m]), left_m)[0].tolist()
        return x_m, y_m


def line(rng: np.random.Generator, campus: Campus, lining: Lining) -> None:
    """Line all streets of a campus in one of the two ways, `street` or `campus`.

    It is not called for a world that is not dense.
    """
    for street in range(len(campus.streets.edges)):
        for sign in (-1, 1):
            side = Side(campus, street, sign)
            if lining == "street":
                _row_of_lots(rng, side)
            else:
                _wayside(rng, side)
            _clutter_spots(rng, side)
    if lining == "campus":
        _feet_of_buildings(rng, campus)
    _undergrowth(rng, campus)


def front(rng: np.random.Generator, template: Template) -> Template:
    """What stands in front of a building's walls, on both long sides of each wing.

    These are piers between the windows, and a porch.
    """
    parts: list[Part] = []
    for wing in template:
        if not _is_wing(wing):
            continue
        for sign in (-1, 1):
            front_m = wing.left_m + sign * wing.half_width_m
            front_parts = _piers(rng, wing.half_length_m, front_m, wing.top_m)
            front_parts += _porch(rng, wing.half_length_m, front_m, sign)
            parts += [replace(part, ahead_m=part.ahead_m + wing.ahead_m) for part in front_parts]
    return tuple(parts)


def _is_wing(part: Part) -> bool:
    """Whether a part of a building is a wing on the ground, not a stair bay or a roof."""
    return part.bottom_m <= 0 and min(part.half_length_m, part.half_width_m) >= 3


def _row_of_lots(rng: np.random.Generator, side: Side) -> None:
    """A row of lots, whose houses share the kind of border and the depth of front gardens."""
    pavement_m = rng.uniform(*PAVEMENT_BOUNDS_M)
    front_m = pavement_m + rng.uniform(*FRONT_GARDEN_BOUNDS_M)
    is_terraced = rng.random() < TERRACED_SHARE
    border = str(rng.choice(BORDERS, p=BORDER_SHARES))
    houses = []
    station_m = FROM_CORNER_M + rng.uniform(0, 4)
    while station_m + HOUSE_LENGTH_BOUNDS_M[1] < side.length_m - FROM_CORNER_M:
        house_m = rng.uniform(*HOUSE_LENGTH_BOUNDS_M)
        gap_m = 0.0 if is_terraced else rng.uniform(*SIDE_GAP_BOUNDS_M)
        middle_m = station_m + (house_m + gap_m) / 2
        house = _lot(
            rng,
            side,
            middle_m,
            house_m,
            gap_m,
            pavement_m=pavement_m,
            front_m=front_m,
            border=border,
        )
        if house:
            houses.append(house)
        station_m += house_m + gap_m
    # `fits` keeps a house away from all that is built. Houses of one row may stand closer, so they
    # are built after all of them were checked.
    for house in houses:
        side.campus.build(house)
    _kerb(rng, side)


def _lot(
    rng: np.random.Generator,
    side: Side,
    middle_m: float,
    house_m: float,
    gap_m: float,
    pavement_m: float,
    front_m: float,
    border: str,
) -> Structure | None:
    """Furnish one lot; returns its house, which is not yet built, or None if it has none."""
    x_m, y_m = side.at(middle_m, 0.0)
    lot = Structure(x_m, y_m, side.yaw_rad, ())
    half_m = (house_m + gap_m) / 2
    half_depth_m = rng.uniform(*HOUSE_HALF_DEPTH_BOUNDS_M)
    back_m = front_m + 2 * half_depth_m
    rear_m = back_m + rng.uniform(*BACK_GARDEN_BOUNDS_M)
    house = replace(lot, parts=_house(rng, house_m / 2, front_m, half_depth_m))
    is_built = rng.random() >= EMPTY_LOT_SHARE and side.campus.fits(house, HOUSE_FROM_STREET_M)

    # Borders: to the street with a gate in it, to the next lot, and at the rear.
    gate_m = rng.uniform(-0.7, 0.7) * half_m
    for start_m, end_m in ((-half_m, gate_m - 0.6), (gate_m + 0.6, half_m)):
        if end_m - start_m > 0.5:
            _border(rng, side.campus, lot, border, (start_m, end_m), pavement_m + 0.3, along=True)
    side_border = str(rng.choice(BORDERS[:3]))
    if gap_m > 0 or not is_built:
        _border(rng, side.campus, lot, side_border, (pavement_m, rear_m), half_m, along=False)
    _border(rng, side.campus, lot, "hedge", (-half_m, half_m), rear_m, along=True)

    # A garage with a parking slot before it, and a shed.
    outbuildings = []
    if gap_m > 3.5 and rng.random() < GARAGE_SHARE:
        garage_x_m = half_m - 1.7
        garage_y_m = max(front_m + rng.uniform(1, 5), DRIVE_M)
        outbuildings.append(Part(garage_x_m, garage_y_m + 2.8, 1.5, 2.8, 0, 2.6))
        x_m, y_m = lot.to_world(np.array([garage_x_m, garage_y_m - 2.8])).tolist()
        side.campus.slots.append(Slot(x_m, y_m, lot.yaw_rad + np.pi / 2))
    if rng.random() < SHED_SHARE:
        shed_x_m = rng.uniform(-0.8, 0.8) * half_m
        outbuildings.append(Part(shed_x_m, rear_m - 2.2, 1.5, 1.2, 0, rng.uniform(1.9, 2.5)))
    _add(side.campus, replace(lot, parts=tuple(outbuildings)))

    # Gardens before and behind the house, or in its place.
    gardens = [(pavement_m + 0.6, front_m - 0.6), (back_m + 0.6, rear_m - 0.6)]
    if not is_built:
        gardens = [(pavement_m + 0.6, rear_m - 0.6)]
    for near_m, far_m in gardens:
        _garden(rng, side.campus, lot, half_m, near_m, far_m)
    if not is_built:
        return None
    house_front = _house_front(rng, house_m / 2, front_m, house.parts[0])
    _add(side.campus, replace(lot, parts=house_front))
    return house


def _house(
    rng: np.random.Generator, half_length_m: float, front_m: float, half_depth_m: float
) -> tuple[Part, ...]:
    """A body, whose front is at y = `front_m`, and a narrower roof on it."""
    top_m = rng.uniform(*EAVES_BOUNDS_M)
    middle_m = front_m + half_depth_m
    return (
        Part(0, middle_m, half_length_m, half_depth_m, 0, top_m),
        Part(0, middle_m, half_length_m, 0.5 * half_depth_m, top_m - 0.1, top_m + 2.2),
    )


def _house_front(
    rng: np.random.Generator, half_length_m: float, front_m: float, body: Part
) -> tuple[Part, ...]:
    """What stands before a house's front: piers, and perhaps a bay, porch or balcony."""
    parts = _piers(rng, half_length_m, front_m, body.top_m)
    if rng.random() < 0.5:
        parts += _bay(rng, half_length_m, front_m, -1)
    if rng.random() < 0.7:
        parts += _porch(rng, half_length_m, front_m, -1)
    if rng.random() < 0.35:
        parts += _balcony(rng, half_length_m, front_m, -1)
    return tuple(parts)


def _piers(
    rng: np.random.Generator, half_length_m: float, front_m: float, top_m: float
) -> list[Part]:
    """The wall between the windows, which stands out a hand's breadth before them."""
    middles_m = np.linspace(0.6 - half_length_m, half_length_m - 0.6, round(half_length_m) + 2)
    return [Part(x_m, front_m, rng.uniform(0.3, 0.7), 0.15, 0, top_m) for x_m in middles_m.tolist()]


def _along_front(rng: np.random.Generator, half_length_m: float) -> float:
    """A random x along the front of a building."""
    return float(rng.uniform(-0.7, 0.7) * half_length_m)


def _bay(rng: np.random.Generator, half_length_m: float, front_m: float, sign: int) -> list[Part]:
    """A bay window; `sign` is the side of the wall on which it is."""
    x_m = _along_front(rng, half_length_m)
    return [Part(x_m, front_m + sign * 0.4, rng.uniform(1.0, 1.6), 0.45, 0, rng.uniform(2.8, 5.0))]


def _porch(rng: np.random.Generator, half_length_m: float, front_m: float, sign: int) -> list[Part]:
    """A step, a post and a canopy at a door; `sign` is the side of the wall on which they are."""
    x_m = _along_front(rng, half_length_m)
    return [
        Part(x_m, front_m + sign * 0.5, 0.9, 0.5, 0, 0.4),
        Part(x_m - 0.9, front_m + sign * 0.5, 0.08, 0.5, 0, 2.3),
        Part(x_m, front_m + sign * 0.5, 1.0, 0.6, 2.3, 2.5),
    ]


def _balcony(
    rng: np.random.Generator, half_length_m: float, front_m: float, sign: int
) -> list[Part]:
    """A balcony on the first floor; `sign` is the side of the wall on which it is."""
    x_m = _along_front(rng, half_length_m)
    return [Part(x_m, front_m + sign * 0.6, rng.uniform(1.2, 2), 0.6, 2.7, 3.8)]


def _border(
    rng: np.random.Generator,
    campus: Campus,
    lot: Structure,
    border: str,
    span_m: tuple[float, float],
    off_m: float,
    along: bool,
) -> None:
    """A hedge, wall or fence in the frame of a lot, in pieces that follow the ground."""
    if border == "open":
        return
    # All three are drawn, whatever the border, so that later draws do not depend on it.
    hedge_size_m = (rng.uniform(*HEDGE_HEIGHT_BOUNDS_M), rng.uniform(*HEDGE_HALF_WIDTH_BOUNDS_M))
    wall_size_m = (rng.uniform(*WALL_HEIGHT_BOUNDS_M), 0.15)
    fence_size_m = (rng.uniform(*FENCE_HEIGHT_BOUNDS_M), 0.05)
    if border == "hedge":
        height_m, half_m = hedge_size_m
        kind = Kind.LEAF
        species = Species.HEDGE
    elif border == "wall":
        height_m, half_m = wall_size_m
        kind = Kind.BORDER
        species = Species.SOLID
    else:
        height_m, half_m = fence_size_m
        kind = Kind.BORDER
        species = Species.PALES

    start_m, end_m = span_m
    pieces = max(1, round((end_m - start_m) / PIECE_M))
    step_m = (end_m - start_m) / pieces
    parts = []
    for piece in range(pieces):
        middle_m = start_m + (piece + 0.5) * step_m
        if along:
            parts.append(Part(middle_m, off_m + half_m, step_m / 2, half_m, 0, height_m))
        else:
            parts.append(Part(off_m, middle_m, half_m, step_m / 2, 0, height_m))
    _add(campus, replace(lot, parts=tuple(parts), kind=kind, species=species))


def _garden(
    rng: np.random.Generator,
    campus: Campus,
    lot: Structure,
    half_m: float,
    near_m: float,
    far_m: float,
) -> None:
    """Bushes and small trees in a lot, for |x| <= `half_m` and y from `near_m` to `far_m`."""
    if far_m <= near_m:
        return
    for _ in range(rng.poisson(BUSHES_PER_M2 * 2 * half_m * (far_m - near_m))):
        place = np.array([rng.uniform(-half_m, half_m), rng.uniform(near_m, far_m)])
        _bush(rng, campus, *lot.to_world(place).tolist())
    # This is the mean for one garden: a lot with a house has two.
    for _ in range(rng.poisson(TREES_PER_LOT / 2)):
        place = np.array([rng.uniform(-half_m, half_m), rng.uniform(near_m, far_m)])
        species = Species.CONIFER if rng.random() < CONIFER_SHARE else Species.DECIDUOUS
        x_m, y_m = lot.to_world(place).tolist()
        height_m = rng.uniform(*GARDEN_TREE_HEIGHT_BOUNDS_M)
        plant = tree(rng, x_m, y_m, height_m, rng.uniform(*GARDEN_TREE_RADIUS_BOUNDS_M), species)
        if _clearance_m(campus, plant.x_m, plant.y_m) > TREE_FROM_STREET_M:
            campus.plants.append(plant)


def _bush(rng: np.random.Generator, campus: Campus, x_m: float, y_m: float) -> None:
    """A bush, unless it would reach into a street."""
    radius_m = rng.uniform(*BUSH_RADIUS_BOUNDS_M)
    height_m = rng.uniform(*BUSH_HEIGHT_BOUNDS_M)
    if _clearance_m(campus, x_m, y_m) > radius_m + CLEAR_OF_STREET_M:
        campus.plants.append(Plant(x_m, y_m, height_m, 0.0, radius_m, Species.HEDGE))


def _kerb(rng: np.random.Generator, side: Side) -> None:
    """The kerb of a street, parking slots at it, and lamps behind it on the left side."""
    origin = Structure(*side.at(side.length_m / 2, 0.0), side.yaw_rad, ())
    pieces = round(side.length_m / PIECE_M)
    step_m = side.length_m / pieces
    middles_m = step_m * (np.arange(pieces) - (pieces - 1) / 2)
    stones = [Part(x_m, 0.45, step_m / 2, 0.15, 0, KERB_HEIGHT_M) for x_m in middles_m.tolist()]
    _add(side.campus, replace(origin, parts=tuple(stones), kind=Kind.GROUND))
    if rng.random() < KERB_ROW_SHARE:
        for station_m in np.arange(14.0, side.length_m - 14.0, KERB_SLOT_M).tolist():
            side.campus.slots.append(Slot(*side.at(station_m, 0.2), side.yaw_rad))
    if side.sign > 0:
        for station_m in np.arange(rng.uniform(8, 14), side.length_m - 8, LAMP_M).tolist():
            lamp = Pole(*side.at(station_m, 1.0), 0.09, 6.5)
            if _clearance_m(side.campus, lamp.x_m, lamp.y_m) > CLEAR_OF_STREET_M:
                side.campus.poles.append(lamp)


def _wayside(rng: np.random.Generator, side: Side) -> None:
    """Hedges, low walls, fences and bushes beside a way of a campus, with bare pieces between."""
    station_m = FROM_CORNER_M
    while station_m + PIECE_BOUNDS_M[1] < side.length_m - FROM_CORNER_M:
        piece_m = rng.uniform(*PIECE_BOUNDS_M)
        off_m = rng.uniform(*BESIDE_BOUNDS_M)
        x_m, y_m = side.at(station_m + piece_m / 2, off_m)
        border = str(rng.choice(BORDERS, p=BORDER_SHARES))
        is_bare = rng.random() < BARE_PIECE_SHARE
        station_m += piece_m + rng.uniform(1, 3)
        if is_bare or not side.campus.is_free(np.array([[x_m, y_m]]), 0.0, 0.0)[0]:
            continue
        lot = Structure(x_m, y_m, side.yaw_rad, ())
        _border(rng, side.campus, lot, border, (-piece_m / 2, piece_m / 2), 0.0, along=True)
        _garden(rng, side.campus, lot, piece_m / 2, 1.0, 6.0)


def _feet_of_buildings(rng: np.random.Generator, campus: Campus) -> None:
    """Bushes along both long sides of the buildings' wings."""
    for building in [thing for thing in campus.structures if thing.kind == Kind.BUILDING]:
        for part in building.parts:
            if not _is_wing(part):
                continue
            for sign in (-1, 1):
                for x_m in np.arange(1 - part.half_length_m, part.half_length_m, FOOT_PITCH_M):
                    off_m = sign * (part.half_width_m + rng.uniform(0.8, 1.8))
                    if rng.random() < FOOT_SHARE:
                        place = np.array([part.ahead_m + x_m, part.left_m + off_m])
                        _bush(rng, campus, *building.to_world(place).tolist())


def _clutter_spots(rng: np.random.Generator, side: Side) -> None:
    """Places beside a street where clutter stands on some days."""
    for station_m in np.arange(FROM_CORNER_M, side.length_m - FROM_CORNER_M, SPOT_M).tolist():
        place = side.at(station_m + rng.uniform(-2, 2), rng.uniform(0.9, 2.2))
        if _clearance_m(side.campus, *place) > SPOT_FROM_STREET_M:
            side.campus.spots.append(Slot(*place, side.yaw_rad + rng.normal(0, 0.2)))


def _undergrowth(rng: np.random.Generator, campus: Campus) -> None:
    """Bushes under trees."""
    trees = [plant for plant in campus.plants if plant.trunk_m > 0]
    for plant in trees:
        if rng.random() < UNDERGROWTH_SHARE:
            beside_m = rng.uniform(-0.6, 0.6, 2)
            _bush(rng, campus, plant.x_m + beside_m[0], plant.y_m + beside_m[1])


def _clearance_m(campus: Campus, x_m: float, y_m: float) -> float:
    """Distance of a place from the border of the nearest street; negative on one."""
    return float(campus.streets.clearance_m(np.array([[x_m, y_m]]))[0])


def _add(campus: Campus, structure: Structure) -> None:
    """Add those parts of a structure that leave the streets free."""
    if not structure.parts:
        return
    off_street_m = campus.streets.clearance_m(structure.footprint_m())
    nearest_m = off_street_m.reshape(len(structure.parts), -1).min(1)
    free_rows = np.flatnonzero(nearest_m > CLEAR_OF_STREET_M / 2)
    parts = tuple(structure.parts[row] for row in free_rows)
    if parts:
        campus.structures.append(replace(structure, parts=parts))
