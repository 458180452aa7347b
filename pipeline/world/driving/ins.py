"""A model of an INS (satellites and inertia): exact poses, except in outages, where the solution drifts."""

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses

OUTAGE_GAPS_M, OUTAGE_LENGTHS_M = (100.0, 500.0), (20.0, 60.0)
DRIFTS_M_PER_M = (0.1, 0.3)


def simulate_ins(rng: np.random.Generator, world_T_body: Poses) -> tuple[Poses, NDArray[np.bool_]]:
    """The poses (n, 4, 4) that an INS reports for the true ones, and which of them are good (n,).

    There are about three outages a kilometre, tens of metres each, in which the position drifts to one side.
    """
    places_m = world_T_body[:, :2, 3]
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places_m, axis=0).T))])
    reported, good = world_T_body.copy(), np.ones(len(world_T_body), bool)
    start_m = rng.uniform(*OUTAGE_GAPS_M)
    while start_m < driven_m[-1]:
        end_m, drift, towards = start_m + rng.uniform(*OUTAGE_LENGTHS_M), rng.uniform(*DRIFTS_M_PER_M), rng.uniform(0, 2 * np.pi)
        blind = (start_m <= driven_m) & (driven_m < end_m)
        reported[blind, :2, 3] += drift * (driven_m[blind] - start_m)[:, None] * (np.cos(towards), np.sin(towards))
        good[blind] = False
        start_m = end_m + rng.uniform(*OUTAGE_GAPS_M)
    return reported, good
