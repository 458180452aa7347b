"""Every random stream of the world, each a generator of its own, so that a new draw in one leaves the others alone."""

from datetime import date
from enum import IntEnum

import numpy as np

_WORD = (1 << 64) - 1


class Stream(IntEnum):
    """What a generator is for; the numbers are part of the world and must never change."""

    STREETS = 1
    GROUND = 2
    BLOCKS = 3
    FURNITURE = 4
    EVENTS = 5
    TREES = 6
    TRAINING_PLAN = 7
    TEST_PLAN = 8
    DRIVE = 9
    DAY = 10
    PILOT = 11
    ODOMETRY = 12


def generator(seed: int, stream: Stream, day: date | None = None) -> np.random.Generator:
    """The generator of one stream; `day` tells sequences apart by their date, never by their place in a table."""
    return np.random.default_rng([seed, int(stream), day.toordinal() if day else 0])


def scan_seed(seed: int, day: date, scan: int) -> np.uint64:
    """The seed of one scan's rays: rays need no state, so blocks of scans may be computed in any order."""
    return np.uint64(((seed << 44) ^ (day.toordinal() << 24) ^ scan) & _WORD)
