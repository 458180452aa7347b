"""The few building templates of a campus.

Real campuses repeat their buildings too, so places look alike.
"""

import numpy as np

from pipeline.world.layout.structures import Part

Template = tuple[Part, ...]

TEMPLATES = 7
FLOOR_M = 3.8
PLINTH_M = 0.6
FLOORS = (2, 6)
HALF_LENGTHS_M = (13.0, 30.0)
HALF_WIDTHS_M = (6.5, 10.5)
STAIR_PITCH_M = 18.0
STAIR_HALF_LENGTH_M = 1.6
STAIR_HALF_WIDTH_M = 0.8
PENTHOUSE_M = 3.0
HOUSES_M = ((4.5, 5.5, 7.2), (5.2, 4.8, 6.6))
"""Half length, half width and ridge height of the two types of house."""


def templates(rng: np.random.Generator) -> list[Template]:
    """The TEMPLATES buildings of a campus: L, U, H and tower shapes of a few floors."""
    building_templates = []
    for number in range(TEMPLATES):
        length_m = rng.uniform(*HALF_LENGTHS_M)
        width_m = rng.uniform(*HALF_WIDTHS_M)
        floors = int(rng.integers(*FLOORS))
        shape = _wings(length_m, width_m, floors)[number % 4]
        wings = [
            Part(*place_m, *half_m, 0, storeys * FLOOR_M + PLINTH_M)
            for place_m, half_m, storeys in shape
        ]
        building_templates.append(tuple(part for wing in wings for part in _with_stairs(wing)))
    return building_templates


def houses() -> list[Template]:
    """The two types of house: a body, and a narrower roof on it."""
    return [
        (
            Part(0, 0, length, width, 0, 0.72 * ridge),
            Part(0, 0, length, 0.45 * width, 0.7 * ridge, ridge),
        )
        for length, width, ridge in HOUSES_M
    ]


Wing = tuple[tuple[float, float], tuple[float, float], int]
"""(ahead, left) of its middle and (half length, half width) in metres, and its floors."""


def _wings(a: float, b: float, floors: int) -> list[list[Wing]]:
    """The wings of the L, U, H and tower shapes.

    Half the length is `a`, half the width `b`, in metres.
    """
    return [
        [((0, 0), (a, b), floors), ((a - b, 1.9 * b), (b, 0.9 * b), floors)],
        [
            ((0, 0), (a, b), floors),
            ((a - b, 1.8 * b), (b, 0.8 * b), floors),
            ((b - a, 1.8 * b), (b, 0.8 * b), floors),
        ],
        [
            ((0, -1.6 * b), (a, 0.7 * b), floors),
            ((0, 1.6 * b), (a, 0.7 * b), floors),
            ((0, 0), (b, 0.9 * b), floors),
        ],
        [
            ((0, 0), (0.5 * a, 1.4 * b), floors + 1),
            ((0.9 * a, 0), (0.4 * a, b), max(floors - 1, 1)),
        ],
    ]


def _with_stairs(wing: Part) -> list[Part]:
    """A wing with stair bays every STAIR_PITCH_M on alternating sides.

    A large one has a penthouse too.
    """
    parts = [wing]
    top_m = wing.top_m
    if wing.half_length_m * wing.half_width_m > 150 and top_m > 2 * FLOOR_M:
        ahead_m = wing.ahead_m + 0.3 * wing.half_length_m
        half_length_m = 0.25 * wing.half_length_m
        parts.append(
            Part(
                ahead_m,
                wing.left_m,
                half_length_m,
                0.4 * wing.half_width_m,
                top_m - 0.1,
                top_m + PENTHOUSE_M,
            )
        )
    starts_m = (
        np.arange(6.0, 2 * wing.half_length_m - 2 * STAIR_HALF_LENGTH_M, STAIR_PITCH_M)
        - wing.half_length_m
    )
    for bay, start_m in enumerate(starts_m):
        side, stair_m = (-1, 0.6 * top_m) if bay % 2 == 0 else (1, top_m)
        left_m = wing.left_m + side * (wing.half_width_m + 0.7)
        parts.append(
            Part(
                wing.ahead_m + start_m, left_m, STAIR_HALF_LENGTH_M, STAIR_HALF_WIDTH_M, 0, stair_m
            )
        )
    return parts
