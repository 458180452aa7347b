"""The random streams of a world: one generator for each purpose.

A new draw in one stream does not change the others, and the numbers of a sequence do not depend on
which sequences are recorded before it.
"""

from collections.abc import Callable
from datetime import date, datetime
from enum import IntEnum
from typing import TypeAlias

import numpy as np

_WORD = (1 << 64) - 1
"""Mask for the lowest 64 bits of a number."""
_GOLDEN = 0x9E3779B97F4A7C15
"""The odd constant of splitmix64, 2⁶⁴ divided by the golden ratio: multiplied by it, seconds that
follow each other differ in about half of their 64 bits."""


class Stream(IntEnum):
    """The purpose of a generator; the numbers are part of the world and must never change."""

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
    VISUAL_ODOMETRY = 13
    OUTAGES = 14
    LOOPS = 15
    FURTHER_EVENTS = 16
    GROUND_TRUTH = 17
    LINING = 18
    CLUTTER = 19


Generators: TypeAlias = Callable[[Stream], np.random.Generator]
"""A function that gives the generator of each stream for one sequence."""


def generator(seed: int, stream: Stream, when: date | None = None) -> np.random.Generator:
    """A fresh generator of one stream, of the whole world or of the sequence on the date `when`.

    Sequences differ by their date and time, so their order in a table does not matter.
    """
    second = _second_of_day(when)
    entropy = [seed, int(stream), when.toordinal() if when else 0]
    return np.random.default_rng(entropy if second is None else [*entropy, second])


def scan_seed(seed: int, when: date, scan: int) -> np.uint64:
    """The seed of the rays of scan number `scan`: scans may be computed in any order."""
    second = _second_of_day(when) or 0
    # The scan is in the bits below 24, the day from 24 on, the world's seed from 44 on. The second,
    # spread over all 64 bits, is XORed in.
    fields = (seed << 44) ^ (when.toordinal() << 24) ^ scan
    return np.uint64((fields ^ (second * _GOLDEN)) & _WORD)


def _second_of_day(when: date | None) -> int | None:
    """The second of the day if `when` has a time, else None: so drives on one day differ."""
    if not isinstance(when, datetime):
        return None
    return 3600 * when.hour + 60 * when.minute + when.second
