"""Street furniture: avenues of one species, lamp posts, parking slots at the kerb."""

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.draft import Draft, Pole, Slot
from pipeline.world.layout.greenery import tree
from pipeline.world.layout.shapes import Species

AVENUE_SHARE_OF_PATHS, AVENUE_SHARE_OF_ROADS = 0.35, 0.55
AVENUE_PITCHES_M, AVENUE_HEIGHTS_M, AVENUE_RADII_M = (9.0, 13.0), (8.0, 13.0), (2.5, 3.8)
AVENUE_FROM_KERB_M, AVENUE_GAPS = 3.2, 0.1
LAMP_PITCH_M, LAMP_FROM_KERB_M, LAMP_RADIUS_M = 30.0, 1.2, 0.09
LAMP_HEIGHT_AT_ROAD_M, LAMP_HEIGHT_AT_PATH_M = 6.5, 4.0
KERB_PARKING_SHARE, KERB_PITCH_M = 0.35, 6.2
FROM_OTHER_STREETS_M = 0.8


def furnish_streets(rng: np.random.Generator, draft: Draft) -> None:
    """Add trees, lamps and parking slots to every street of the draft."""
    streets = draft.streets
    along, left = streets.directions()
    for street, is_path in enumerate(streets.is_path):
        length_m, half_width_m = streets.lengths_m[street], streets.half_widths_m[street]
        if rng.random() < (AVENUE_SHARE_OF_PATHS if is_path else AVENUE_SHARE_OF_ROADS):
            pitch_m = rng.uniform(*AVENUE_PITCHES_M)
            sides = [(-1,), (1,), (-1, 1)][rng.integers(3)]
            aside_m = half_width_m + AVENUE_FROM_KERB_M
            stations = [(s, side * aside_m) for s in np.arange(10, length_m - 9, pitch_m) for side in sides]
            _avenue(rng, draft, _beside(draft, street, along, left, stations))
        side = rng.choice([-1, 1])
        aside_m = side * (half_width_m + LAMP_FROM_KERB_M)
        stations = [(s, aside_m) for s in np.arange(rng.uniform(5, 15), length_m - 4, LAMP_PITCH_M)]
        lamps = _beside(draft, street, along, left, stations)
        height_m = LAMP_HEIGHT_AT_PATH_M if is_path else LAMP_HEIGHT_AT_ROAD_M
        lamps = lamps[draft.free(lamps, FROM_OTHER_STREETS_M, 0.0)]
        draft.poles.extend(Pole(float(x), float(y), LAMP_RADIUS_M, height_m) for x, y in lamps)
        if not is_path and rng.random() < KERB_PARKING_SHARE:
            stations = [(s, side * (half_width_m + 0.2)) for s in np.arange(14, length_m - 14, KERB_PITCH_M)]
            yaw = float(np.arctan2(along[street, 1], along[street, 0]))
            draft.slots.extend(Slot(float(x), float(y), yaw) for x, y in _beside(draft, street, along, left, stations))


def _beside(
    draft: Draft, street: int, along: NDArray[np.float64], left: NDArray[np.float64], stations: list[tuple[float, float]]
) -> NDArray[np.float64]:
    """World points (n, 2) in metres of pairs (metres along the street, metres left of its middle)."""
    table = np.array(stations).reshape(-1, 2)
    return np.asarray(draft.streets.starts_m[street] + table[:, :1] * along[street] + table[:, 1:] * left[street])


def _avenue(rng: np.random.Generator, draft: Draft, places_m: NDArray[np.float64]) -> None:
    """Trees of one species and one size ± 15 %, at the free ones of the places (n, 2)."""
    height_m, radius_m = rng.uniform(*AVENUE_HEIGHTS_M), rng.uniform(*AVENUE_RADII_M)
    places_m = places_m[draft.free(places_m, FROM_OTHER_STREETS_M, 1.0)]
    for x_m, y_m in places_m[rng.random(len(places_m)) >= AVENUE_GAPS]:
        height_m_here, radius_m_here = height_m * rng.uniform(0.85, 1.15), radius_m * rng.uniform(0.85, 1.15)
        draft.plants.append(tree(rng, float(x_m), float(y_m), height_m_here, radius_m_here, Species.DECIDUOUS))
