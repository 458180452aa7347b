"""What stands close along the streets of a dense world, .3 to 5 m above the ground.

A `street` is narrow, with houses, gardens and cars on both sides, as in an old suburb; a `campus`
keeps its blocks and has hedges, low walls and bushes beside its ways and at the feet of its
buildings. The shares, pitches and sizes in capitals were set so that scans and views are about as
full as recorded ones (docs/measured.md, 'How full views are'), never by the score of a method.
"""

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from pipeline.world.layout.buildings import Template
from pipeline.world.layout.campus import Campus, Pole, Slot
from pipeline.world.layout.greenery import Plant, tree
from pipeline.world.layout.shapes import Kind, Species
from pipeline.world.layout.structures import Part, Structure

Lining: TypeAlias = Literal["sparse", "street", "campus"]
"""What lines the streets; sparse: nothing but what the blocks hold."""

PAVEMENTS_M = (1.5, 2.6)
FRONT_GARDENS_M = (1.0, 8.0)
"""Depth of the gardens between the pavement and the houses of one row."""
LOTS_M = (9.0, 15.0)
TERRACED_SHARE = 0.3
SIDE_GAPS_M = (4.0, 9.0)
"""Between detached houses."""
EMPTY_LOTS = 0.25
EAVES_M = (4.8, 7.2)
HOUSE_HALF_DEPTHS_M = (4.2, 6.0)
HOUSE_FROM_STREET_M = 1.2
FROM_CORNER_M = 7.0
BACK_GARDENS_M = (6.0, 13.0)
BORDERS = ("hedge", "wall", "fence", "open")
BORDER_SHARES = (0.35, 0.2, 0.2, 0.25)
HEDGE_HEIGHTS_M = (0.6, 1.5)
HEDGE_HALF_WIDTHS_M = (0.35, 0.7)
WALL_HEIGHTS_M = (0.4, 1.2)
FENCE_HEIGHTS_M = (0.8, 1.4)
BUSHES_PER_M2 = 0.07
BUSH_RADII_M = (0.4, 1.1)
BUSH_HEIGHTS_M = (0.4, 1.6)
TREES_PER_LOT = 1.2
GARDEN_TREE_HEIGHTS_M = (4.0, 9.0)
GARDEN_TREE_RADII_M = (1.2, 3.0)
CONIFERS = 0.3
GARAGES = 0.5
SHEDS = 0.6
KERB_SLOT_M = 5.8
KERB_ROWS = 0.6
"""The share of roadsides where cars may park."""
SPOT_M = 6.0
"""Along a street, between places where clutter may stand on some days."""
KERB_HEIGHT_M = 0.12
PIECE_M = 4.0
"""About the length of a piece of a kerb, hedge, wall or fence, whose top is level."""
LAMP_M = 28.0
CLEAR_OF_STREET_M = 0.3
TREE_FROM_STREET_M = 1.0
SPOT_FROM_STREET_M = 0.8
DRIVE_M = 5.4
"""A car before a garage stays off the street."""

PIECES_M = (4.0, 8.0)
BARE_PIECES = 0.75
"""Of a campus: the share of its waysides with nothing beside."""
BESIDE_M = (2.0, 12.0)
FOOT_PITCH_M = 2.2
FOOT_SHARE = 0.2
"""Bushes at the feet of buildings: their pitch, and how many of those places have one."""
UNDERGROWTH_SHARE = 0.2


@dataclass(frozen=True)
class Side:
    """One side of a street: x along it, y from its border away from it."""

    campus: Campus
    street: int
    sign: int
    """1: left, −1: right."""

    @property
    def length_m(self) -> float:
        return float(self.campus.streets.lengths_m[self.street])

    @property
    def yaw_rad(self) -> float:
        """The heading of its x axis, so that its y axis points away from the street."""
        along_x, along_y = self.campus.streets.directions()[0][self.street]
        return float(np.arctan2(along_y, along_x)) + (0.0 if self.sign > 0 else np.pi)

    def at(self, station_m: float, off_m: float) -> tuple[float, float]:
        """World x, y of a place `station_m` along the street and `off_m` off its border."""
        streets = self.campus.streets
        left_m = self.sign * (streets.half_widths_m[self.street] + off_m)
        x_m, y_m = streets.beside(self.street, np.array([station_m]), left_m)[0].tolist()
        return x_m, y_m


def line(rng: np.random.Generator, campus: Campus, lining: Lining) -> None:
    """Line all streets of `campus`."""
    sides = [
        Side(campus, street, sign)
        for street in range(len(campus.streets.edges))
        for sign in (-1, 1)
    ]
    for side in sides:
        if lining == "street":
            _row(rng, side)
        else:
            _wayside(rng, side)
        _spots(rng, side)
    if lining == "campus":
        _feet(rng, campus)
    _undergrowth(rng, campus)


def front(rng: np.random.Generator, template: Template) -> Template:
    """Piers between the windows of a building and steps with a canopy at its doors, on both long
    sides of each wing."""
    parts: list[Part] = []
    for wing in template:
        if wing.bottom_m > 0 or min(wing.half_length_m, wing.half_width_m) < 3:
            continue
        for sign in (-1, 1):
            front_m = wing.left_m + sign * wing.half_width_m
            parts += [
                replace(part, ahead_m=part.ahead_m + wing.ahead_m)
                for part in _piers(rng, wing.half_length_m, front_m, wing.top_m)
                + _porch(rng, wing.half_length_m, front_m, sign)
            ]
    return tuple(parts)


def _row(rng: np.random.Generator, side: Side) -> None:
    """A row of lots with houses, one border and one depth of front garden for all of them."""
    pavement_m = rng.uniform(*PAVEMENTS_M)
    front_m = pavement_m + rng.uniform(*FRONT_GARDENS_M)
    terraced = rng.random() < TERRACED_SHARE
    border = str(rng.choice(BORDERS, p=BORDER_SHARES))
    houses = []
    station_m = FROM_CORNER_M + rng.uniform(0, 4)
    while station_m + LOTS_M[1] < side.length_m - FROM_CORNER_M:
        lot_m = rng.uniform(*LOTS_M)
        gap_m = 0.0 if terraced else rng.uniform(*SIDE_GAPS_M)
        middle_m = station_m + (lot_m + gap_m) / 2
        houses += _lot(rng, side, middle_m, lot_m, gap_m, pavement_m, front_m, border)
        station_m += lot_m + gap_m
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
) -> list[Structure]:
    """Plant a lot and return its house, if it has one and it fits."""
    x_m, y_m = side.at(middle_m, 0.0)
    lot = Structure(x_m, y_m, side.yaw_rad, ())
    half_m = (house_m + gap_m) / 2
    half_depth_m = rng.uniform(*HOUSE_HALF_DEPTHS_M)
    back_m = front_m + 2 * half_depth_m
    rear_m = back_m + rng.uniform(*BACK_GARDENS_M)
    house = replace(lot, parts=_house(rng, house_m / 2, front_m, half_depth_m))
    built = rng.random() >= EMPTY_LOTS and side.campus.fits(house, HOUSE_FROM_STREET_M)
    gate_m = rng.uniform(-0.7, 0.7) * half_m
    for start_m, end_m in ((-half_m, gate_m - 0.6), (gate_m + 0.6, half_m)):
        if end_m - start_m > 0.5:
            _border(rng, side.campus, lot, border, (start_m, end_m), pavement_m + 0.3, along=True)
    party = str(rng.choice(BORDERS[:3]))
    if gap_m > 0 or not built:
        _border(rng, side.campus, lot, party, (pavement_m, rear_m), half_m, along=False)
    _border(rng, side.campus, lot, "hedge", (-half_m, half_m), rear_m, along=True)
    things = []
    if gap_m > 3.5 and rng.random() < GARAGES:
        inset_m = max(front_m + rng.uniform(1, 5), DRIVE_M)
        things.append(Part(half_m - 1.7, inset_m + 2.8, 1.5, 2.8, 0, 2.6))
        x_m, y_m = lot.to_world(np.array([half_m - 1.7, inset_m - 2.8])).tolist()
        side.campus.slots.append(Slot(x_m, y_m, lot.yaw_rad + np.pi / 2))
    if rng.random() < SHEDS:
        things.append(
            Part(rng.uniform(-0.8, 0.8) * half_m, rear_m - 2.2, 1.5, 1.2, 0, rng.uniform(1.9, 2.5))
        )
    _add(side.campus, replace(lot, parts=tuple(things)))
    gardens = [(pavement_m + 0.6, front_m - 0.6), (back_m + 0.6, rear_m - 0.6)]
    if not built:
        gardens = [(pavement_m + 0.6, rear_m - 0.6)]
    for near_m, far_m in gardens:
        _garden(rng, side.campus, lot, half_m, near_m, far_m)
    if not built:
        return []
    _add(side.campus, replace(lot, parts=_house_front(rng, house_m / 2, front_m, house.parts[0])))
    return [house]


def _house(
    rng: np.random.Generator, half_length_m: float, front_m: float, half_depth_m: float
) -> tuple[Part, ...]:
    """A body and a narrower roof on it."""
    top_m = rng.uniform(*EAVES_M)
    middle_m = front_m + half_depth_m
    return (
        Part(0, middle_m, half_length_m, half_depth_m, 0, top_m),
        Part(0, middle_m, half_length_m, 0.5 * half_depth_m, top_m - 0.1, top_m + 2.2),
    )


def _house_front(
    rng: np.random.Generator, half_length_m: float, front_m: float, body: Part
) -> tuple[Part, ...]:
    """The depth of its front, at y = `front_m`: piers, a bay, a porch, a balcony."""
    parts = _piers(rng, half_length_m, front_m, body.top_m)
    for chance, place in ((0.5, _bay), (0.7, _porch), (0.35, _balcony)):
        if rng.random() < chance:
            parts += place(rng, half_length_m, front_m, -1)
    return tuple(parts)


def _piers(
    rng: np.random.Generator, half_length_m: float, front_m: float, top_m: float
) -> list[Part]:
    """Wall between the windows, which lie a hand's breadth behind it."""
    middles_m = np.linspace(0.6 - half_length_m, half_length_m - 0.6, round(half_length_m) + 2)
    return [Part(x_m, front_m, rng.uniform(0.3, 0.7), 0.15, 0, top_m) for x_m in middles_m.tolist()]


def _along(rng: np.random.Generator, half_length_m: float) -> float:
    return float(rng.uniform(-0.7, 0.7) * half_length_m)


def _bay(rng: np.random.Generator, half_length_m: float, front_m: float, sign: int) -> list[Part]:
    x_m = _along(rng, half_length_m)
    return [Part(x_m, front_m + sign * 0.4, rng.uniform(1.0, 1.6), 0.45, 0, rng.uniform(2.8, 5.0))]


def _porch(rng: np.random.Generator, half_length_m: float, front_m: float, sign: int) -> list[Part]:
    x_m = _along(rng, half_length_m)
    return [
        Part(x_m, front_m + sign * 0.5, 0.9, 0.5, 0, 0.4),
        Part(x_m - 0.9, front_m + sign * 0.5, 0.08, 0.5, 0, 2.3),
        Part(x_m, front_m + sign * 0.5, 1.0, 0.6, 2.3, 2.5),
    ]


def _balcony(
    rng: np.random.Generator, half_length_m: float, front_m: float, sign: int
) -> list[Part]:
    return [
        Part(_along(rng, half_length_m), front_m + sign * 0.6, rng.uniform(1.2, 2), 0.6, 2.7, 3.8)
    ]


def _border(
    rng: np.random.Generator,
    campus: Campus,
    lot: Structure,
    border: str,
    span_m: tuple[float, float],
    off_m: float,
    along: bool,
) -> None:
    """A hedge, wall or fence from one end to the other of `span_m` in the frame of a lot, along the
    street or away from it, in pieces that follow the ground."""
    if border == "open":
        return
    height_m, half_m = {
        "hedge": (rng.uniform(*HEDGE_HEIGHTS_M), rng.uniform(*HEDGE_HALF_WIDTHS_M)),
        "wall": (rng.uniform(*WALL_HEIGHTS_M), 0.15),
        "fence": (rng.uniform(*FENCE_HEIGHTS_M), 0.05),
    }[border]
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
    kind, species = {
        "hedge": (Kind.LEAF, Species.HEDGE),
        "wall": (Kind.BORDER, Species.SOLID),
        "fence": (Kind.BORDER, Species.PALES),
    }[border]
    _add(campus, replace(lot, parts=tuple(parts), kind=kind, species=species))


def _garden(
    rng: np.random.Generator,
    campus: Campus,
    lot: Structure,
    half_m: float,
    near_m: float,
    far_m: float,
) -> None:
    """Bushes and small trees in the rectangle of a lot from `near_m` to `far_m` off the street."""
    if far_m <= near_m:
        return
    for _ in range(rng.poisson(BUSHES_PER_M2 * 2 * half_m * (far_m - near_m))):
        place = np.array([rng.uniform(-half_m, half_m), rng.uniform(near_m, far_m)])
        _bush(rng, campus, *lot.to_world(place).tolist())
    for _ in range(rng.poisson(TREES_PER_LOT / 2)):
        place = np.array([rng.uniform(-half_m, half_m), rng.uniform(near_m, far_m)])
        species = Species.CONIFER if rng.random() < CONIFERS else Species.DECIDUOUS
        x_m, y_m = lot.to_world(place).tolist()
        height_m = rng.uniform(*GARDEN_TREE_HEIGHTS_M)
        grown = tree(rng, x_m, y_m, height_m, rng.uniform(*GARDEN_TREE_RADII_M), species)
        if _clearance_m(campus, grown.x_m, grown.y_m) > TREE_FROM_STREET_M:
            campus.plants.append(grown)


def _bush(rng: np.random.Generator, campus: Campus, x_m: float, y_m: float) -> None:
    radius_m = rng.uniform(*BUSH_RADII_M)
    height_m = rng.uniform(*BUSH_HEIGHTS_M)
    if _clearance_m(campus, x_m, y_m) > radius_m + CLEAR_OF_STREET_M:
        campus.plants.append(Plant(x_m, y_m, height_m, 0.0, radius_m, Species.HEDGE))


def _kerb(rng: np.random.Generator, side: Side) -> None:
    """The kerb of a road, cars parked on it, and lamps behind it."""
    origin = Structure(*side.at(side.length_m / 2, 0.0), side.yaw_rad, ())
    pieces = round(side.length_m / PIECE_M)
    step_m = side.length_m / pieces
    middles_m = step_m * (np.arange(pieces) - (pieces - 1) / 2)
    stones = tuple(Part(m, 0.45, step_m / 2, 0.15, 0, KERB_HEIGHT_M) for m in middles_m.tolist())
    _add(side.campus, replace(origin, parts=stones, kind=Kind.GROUND))
    if rng.random() < KERB_ROWS:
        for station_m in np.arange(14.0, side.length_m - 14.0, KERB_SLOT_M).tolist():
            side.campus.slots.append(Slot(*side.at(station_m, 0.2), side.yaw_rad))
    if side.sign > 0:
        for station_m in np.arange(rng.uniform(8, 14), side.length_m - 8, LAMP_M).tolist():
            lamp = Pole(*side.at(station_m, 1.0), 0.09, 6.5)
            if _clearance_m(side.campus, lamp.x_m, lamp.y_m) > CLEAR_OF_STREET_M:
                side.campus.poles.append(lamp)


def _wayside(rng: np.random.Generator, side: Side) -> None:
    """Hedges, low walls, fences and groups of bushes beside a way of a campus, with bare pieces
    between."""
    station_m = FROM_CORNER_M
    while station_m + PIECES_M[1] < side.length_m - FROM_CORNER_M:
        piece_m = rng.uniform(*PIECES_M)
        off_m = rng.uniform(*BESIDE_M)
        x_m, y_m = side.at(station_m + piece_m / 2, off_m)
        border = str(rng.choice(BORDERS, p=BORDER_SHARES))
        is_bare = rng.random() < BARE_PIECES
        station_m += piece_m + rng.uniform(1, 3)
        if is_bare or not side.campus.free(np.array([[x_m, y_m]]), 0.0, 0.0)[0]:
            continue
        lot = Structure(x_m, y_m, side.yaw_rad, ())
        _border(rng, side.campus, lot, border, (-piece_m / 2, piece_m / 2), 0.0, along=True)
        _garden(rng, side.campus, lot, piece_m / 2, 1.0, 6.0)


def _feet(rng: np.random.Generator, campus: Campus) -> None:
    """Bushes at the feet of the buildings."""
    for building in [thing for thing in campus.structures if thing.kind == Kind.BUILDING]:
        for part in building.parts:
            if part.bottom_m > 0 or min(part.half_length_m, part.half_width_m) < 3:
                continue
            for sign in (-1, 1):
                for x_m in np.arange(1 - part.half_length_m, part.half_length_m, FOOT_PITCH_M):
                    off_m = sign * (part.half_width_m + rng.uniform(0.8, 1.8))
                    if rng.random() < FOOT_SHARE:
                        place = np.array([part.ahead_m + x_m, part.left_m + off_m])
                        _bush(rng, campus, *building.to_world(place).tolist())


def _spots(rng: np.random.Generator, side: Side) -> None:
    """Places beside a street where something stands on some days."""
    for station_m in np.arange(FROM_CORNER_M, side.length_m - FROM_CORNER_M, SPOT_M).tolist():
        place = side.at(station_m + rng.uniform(-2, 2), rng.uniform(0.9, 2.2))
        if _clearance_m(side.campus, *place) > SPOT_FROM_STREET_M:
            side.campus.spots.append(Slot(*place, side.yaw_rad + rng.normal(0, 0.2)))


def _undergrowth(rng: np.random.Generator, campus: Campus) -> None:
    """Bushes under trees."""
    for plant in [plant for plant in campus.plants if plant.trunk_m > 0]:
        if rng.random() < UNDERGROWTH_SHARE:
            beside_m = rng.uniform(-0.6, 0.6, 2)
            _bush(rng, campus, plant.x_m + beside_m[0], plant.y_m + beside_m[1])


def _clearance_m(campus: Campus, x_m: float, y_m: float) -> float:
    return float(campus.streets.clearance_m(np.array([[x_m, y_m]]))[0])


def _add(campus: Campus, structure: Structure) -> None:
    """Add those parts of a structure that leave the streets free."""
    if structure.parts:
        off_m = campus.streets.clearance_m(structure.outline_m())
        nearest_m = off_m.reshape(len(structure.parts), -1).min(1)
        parts = tuple(
            structure.parts[row] for row in np.flatnonzero(nearest_m > CLEAR_OF_STREET_M / 2)
        )
        if parts:
            campus.structures.append(replace(structure, parts=parts))
