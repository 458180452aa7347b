"""Street furniture: adds avenues of trees, lamp posts and parking slots at the kerb to a campus."""

import numpy as np

from worlds import Floats
from worlds.layout.campus import Campus, Pole, Slot
from worlds.layout.greenery import tree
from worlds.layout.shapes import Species

AVENUE_SHARE_OF_PATHS = 0.35
"""Share of the footpaths that are avenues."""
AVENUE_SHARE_OF_ROADS = 0.55
AVENUE_PITCH_BOUNDS_M = (9.0, 13.0)
"""Bounds of the distance between the trees of an avenue."""
AVENUE_HEIGHT_BOUNDS_M = (8.0, 13.0)
AVENUE_RADIUS_BOUNDS_M = (2.5, 3.8)
AVENUE_FROM_KERB_M = 3.2
AVENUE_GAP_SHARE = 0.1
"""Share of the trees that are missing."""
LAMP_PITCH_M = 30.0
LAMP_FROM_KERB_M = 1.2
LAMP_RADIUS_M = 0.09
LAMP_HEIGHT_AT_ROAD_M = 6.5
LAMP_HEIGHT_AT_PATH_M = 4.0
KERB_PARKING_SHARE = 0.35
"""Share of the roads with parking slots at one kerb."""
KERB_PITCH_M = 6.2
"""Distance from one of these slots to the next."""
FROM_OTHER_STREETS_M = 0.8
"""Least distance of trees and lamps from any street."""


def furnish_streets(rng: np.random.Generator, campus: Campus, has_avenues: bool = True) -> None:
    """Add trees, unless there are no avenues, lamps and parking slots to all streets."""
    streets = campus.streets
    for street, is_path in enumerate(streets.is_path):
        length_m = streets.lengths_m[street]
        half_width_m = streets.half_widths_m[street]
        # Trees on one side, on the other, or on both.
        avenue_share = AVENUE_SHARE_OF_PATHS if is_path else AVENUE_SHARE_OF_ROADS
        if rng.random() < avenue_share and has_avenues:
            stations_m = np.arange(10, length_m - 9, rng.uniform(*AVENUE_PITCH_BOUNDS_M))
            sides = [(-1,), (1,), (-1, 1)][rng.integers(3)]
            left_m = np.tile(sides, len(stations_m)) * (half_width_m + AVENUE_FROM_KERB_M)
            _avenue(rng, campus, streets.beside(street, np.repeat(stations_m, len(sides)), left_m))
        # Lamps on one side.
        side = rng.choice([-1, 1])
        stations_m = np.arange(rng.uniform(5, 15), length_m - 4, LAMP_PITCH_M)
        lamps_m = streets.beside(street, stations_m, side * (half_width_m + LAMP_FROM_KERB_M))
        lamps_m = lamps_m[campus.is_free(lamps_m, FROM_OTHER_STREETS_M, 0.0)]
        height_m = LAMP_HEIGHT_AT_PATH_M if is_path else LAMP_HEIGHT_AT_ROAD_M
        campus.poles.extend(
            Pole(x_m, y_m, LAMP_RADIUS_M, height_m) for x_m, y_m in lamps_m.tolist()
        )
        # Parking slots on the same side of some roads.
        if not is_path and rng.random() < KERB_PARKING_SHARE:
            stations_m = np.arange(14, length_m - 14, KERB_PITCH_M)
            along, _ = streets.directions()
            along_x, along_y = along[street]
            yaw_rad = float(np.arctan2(along_y, along_x))
            places_m = streets.beside(street, stations_m, side * (half_width_m + 0.2))
            campus.slots.extend(Slot(x_m, y_m, yaw_rad) for x_m, y_m in places_m.tolist())


def _avenue(rng: np.random.Generator, campus: Campus, places_m: Floats) -> None:
    """Plant trees of one species and one size ± 15 % at the free ones of places (n, 2)."""
    height_m = rng.uniform(*AVENUE_HEIGHT_BOUNDS_M)
    radius_m = rng.uniform(*AVENUE_RADIUS_BOUNDS_M)
    places_m = places_m[campus.is_free(places_m, FROM_OTHER_STREETS_M, 1.0)]
    for x_m, y_m in places_m[rng.random(len(places_m)) >= AVENUE_GAP_SHARE].tolist():
        tree_height_m = height_m * rng.uniform(0.85, 1.15)
        tree_radius_m = radius_m * rng.uniform(0.85, 1.15)
        campus.plants.append(tree(rng, x_m, y_m, tree_height_m, tree_radius_m, Species.DECIDUOUS))
