"""Foliage over the year: the share of leaves, and the resulting density of a crown for a ray."""

from datetime import date

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.shapes import Species

BARE_UNTIL, FULL_FROM, FULL_UNTIL, BARE_FROM = (4, 15), (5, 30), (9, 22), (11, 14)
"""(month, day): leaves come out between the first two and fall between the last two, as in Michigan."""

BARE_AND_LEAVES_PER_M = {Species.DECIDUOUS: (0.06, 0.85), Species.CONIFER: (1.1, 0.0), Species.HEDGE: (0.5, 1.5)}
"""Extinction per metre of the twigs, and of all leaves, which adds to it; the free path of a ray is −log(u) / extinction."""


def foliage(day: date) -> float:
    """The share of the leaves that are out on `day`, 0 to 1."""
    turns = [date(day.year, *turn).toordinal() for turn in (BARE_UNTIL, FULL_FROM, FULL_UNTIL, BARE_FROM)]
    return float(np.interp(day.toordinal(), turns, [0.0, 1.0, 1.0, 0.0]))


def extinction_per_m(species: NDArray[np.int64], day: date) -> NDArray[np.float64]:
    """Extinction (n,) of shapes of these `species` (n,) on `day`; solid ones get 0."""
    density = np.zeros(len(species))
    for kind, (bare, leaves) in BARE_AND_LEAVES_PER_M.items():
        density[species == kind] = bare + leaves * foliage(day)
    return density
