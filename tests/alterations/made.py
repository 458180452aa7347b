"""Alters one cloud of points, for the tests of all alterations."""

import numpy as np

from pipeline.alterations import Alteration


def altered(
    alteration: Alteration, points_m: np.ndarray, stamp_ns: int = 3
) -> list[tuple[np.ndarray, float]]:
    """For each case the altered points and the turn in radians, of the query with this stamp."""
    rngs = [np.random.default_rng((alteration.seed, stamp_ns)) for _ in alteration.cases]
    return [
        alteration.alter(case, points_m, rng)
        for case, rng in zip(alteration.cases, rngs, strict=True)
    ]
