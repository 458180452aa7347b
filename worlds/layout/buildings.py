"""The building templates of a campus: boxes in the frame of a building, put together at random.

A campus has only a few of them and repeats them, as real campuses do, so that places look similar.
"""

from typing import NamedTuple

import numpy as np

from worlds.layout.structures import Part

Template = tuple[Part, ...]
"""The boxes of a building."""

TEMPLATES = 7
"""Number of large buildings that a campus repeats."""
FLOOR_M = 3.8
PLINTH_M = 0.6
"""Height of the ground floor above the ground."""
FLOOR_BOUNDS = (2, 6)
"""Lowest number of floors, and the one above the highest."""
HALF_LENGTH_BOUNDS_M = (13.0, 30.0)
HALF_WIDTH_BOUNDS_M = (6.5, 10.5)
STAIR_PITCH_M = 18.0
"""Distance from one stair bay of a wing to the next."""
STAIR_HALF_LENGTH_M = 1.6
STAIR_HALF_WIDTH_M = 0.8
PENTHOUSE_M = 3.0
"""Height of a penthouse above the roof."""
HOUSES_M = ((4.5, 5.5, 7.2), (5.2, 4.8, 6.6))
"""Half length, half width and ridge height of the two types of house."""


def templates(rng: np.random.Generator) -> list[Template]:
    """Draw TEMPLATES random buildings: L, U, H and tower shapes of a few floors."""
    building_templates = []
    for number in range(TEMPLATES):
        half_length_m = rng.uniform(*HALF_LENGTH_BOUNDS_M)
        half_width_m = rng.uniform(*HALF_WIDTH_BOUNDS_M)
        floors = int(rng.integers(*FLOOR_BOUNDS))
        # The four shapes take turns.
        wings = _wings(half_length_m, half_width_m, floors)[number % 4]
        parts = []
        for wing in wings:
            ahead_m, left_m = wing.middle_m
            top_m = wing.floors * FLOOR_M + PLINTH_M
            body = Part(ahead_m, left_m, wing.half_length_m, wing.half_width_m, 0, top_m)
            parts += _with_stairs(body)
        building_templates.append(tuple(parts))
    return building_templates


def houses() -> list[Template]:
    """The two types of house: a body with a narrower roof on it."""
    return [
        (
            Part(0, 0, length, width, 0, 0.72 * ridge),
            Part(0, 0, length, 0.45 * width, 0.7 * ridge, ridge),
        )
        for length, width, ridge in HOUSES_M
    ]


class _Wing(NamedTuple):
    """One box of a building's ground plan."""

    middle_m: tuple[float, float]
    """Its middle in the building's frame: ahead, and to the left."""
    half_length_m: float
    half_width_m: float
    floors: int


def _wings(half_length_m: float, half_width_m: float, floors: int) -> list[list[_Wing]]:
    """The wings of the L, the U, the H and the tower shape, given the size of the main wing."""
    a = half_length_m
    b = half_width_m
    main = _Wing((0, 0), a, b, floors)
    return [
        [main, _Wing((a - b, 1.9 * b), b, 0.9 * b, floors)],
        [
            main,
            _Wing((a - b, 1.8 * b), b, 0.8 * b, floors),
            _Wing((b - a, 1.8 * b), b, 0.8 * b, floors),
        ],
        [
            _Wing((0, -1.6 * b), a, 0.7 * b, floors),
            _Wing((0, 1.6 * b), a, 0.7 * b, floors),
            _Wing((0, 0), b, 0.9 * b, floors),
        ],
        [
            _Wing((0, 0), 0.5 * a, 1.4 * b, floors + 1),
            _Wing((0.9 * a, 0), 0.4 * a, b, max(floors - 1, 1)),
        ],
    ]


def _with_stairs(wing: Part) -> list[Part]:
    """A wing with stair bays on alternating sides, and a penthouse if it is large."""
    parts = [wing]
    top_m = wing.top_m
    if wing.half_length_m * wing.half_width_m > 150 and top_m > 2 * FLOOR_M:
        penthouse = Part(
            ahead_m=wing.ahead_m + 0.3 * wing.half_length_m,
            left_m=wing.left_m,
            half_length_m=0.25 * wing.half_length_m,
            half_width_m=0.4 * wing.half_width_m,
            bottom_m=top_m - 0.1,
            top_m=top_m + PENTHOUSE_M,
        )
        parts.append(penthouse)
    last_m = 2 * wing.half_length_m - 2 * STAIR_HALF_LENGTH_M
    bays_m = np.arange(6.0, last_m, STAIR_PITCH_M) - wing.half_length_m
    for number, bay_m in enumerate(bays_m):
        is_right = number % 2 == 0
        side = -1 if is_right else 1
        bay = Part(
            ahead_m=wing.ahead_m + bay_m,
            left_m=wing.left_m + side * (wing.half_width_m + 0.7),
            half_length_m=STAIR_HALF_LENGTH_M,
            half_width_m=STAIR_HALF_WIDTH_M,
            bottom_m=0,
            top_m=0.6 * top_m if is_right else top_m,
        )
        parts.append(bay)
    return parts
