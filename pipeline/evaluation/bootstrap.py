"""95 % intervals by a block bootstrap: how much a number would change on other streets.

In: a function that computes numbers from weighted queries, and where the queries lie. Out: the
lowest and highest value of each number. The steps:

1. cut the path into blocks of `block_m` metres;
2. draw as many blocks as there are, with replacement, `resamples` times: a query then counts as
   often as its block was drawn;
3. compute the numbers on each resample, and take the 2.5th and 97.5th percentile of each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import travelled_m
from pipeline.core.settings import Count, Positive, Seed, checked

BOUNDS = (2.5, 97.5)
"""Percentiles."""
CHUNK = 1 << 17
"""The number of weights held in memory at a time: 1 MB of float64."""
Numbers = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Computes m numbers (m, r) from the weights (r, q) of q queries in r resamples."""


class Estimate(NamedTuple):
    """A number and the lowest and highest of its 95 % interval; NaN where there is none."""

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan


NONE = Estimate()
"""Stands for a number that does not exist."""


@dataclass(frozen=True)
@checked("bootstrap")
class Bootstrap:
    """Resamples blocks of the path, not queries, since errors of neighbouring queries come in runs.

    A number that is the same in all resamples, such as a recall of 1, has an interval of no width:
    the path holds no query on which the method fails.
    """

    block_m: Positive = 50.0
    """Length of a block along the path; longer than a run of errors."""
    resamples: Count = 1000
    seed: Seed = 0

    def intervals(self, numbers: Numbers, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lowest and highest (m, 2) of m numbers of queries along a path `xy_m` (q, 2).

        Resamples in which a number is undefined (NaN) are left out. Its bounds are NaN if it is
        undefined on the path itself, and if the path has a single block.
        """
        resampled = self.resampled_values(numbers, xy_m)
        return np.array([bounds(values) for values in resampled], np.float64).reshape(-1, 2)

    def estimates(self, numbers: Numbers, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The m numbers of all queries, each with its value, lowest and highest (m, 3)."""
        return np.concatenate(
            [numbers(np.ones((1, len(xy_m)))), self.intervals(numbers, xy_m)], axis=1
        )

    def resampled_values(
        self, numbers: Numbers, xy_m: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """The values of each of m numbers in the resamples that define it.

        Empty for a number whose bounds are NaN (see `intervals`).
        """
        block = blocks(xy_m, self.block_m)
        block_count = block.max(initial=-1) + 1
        estimates = numbers(np.ones((1, len(xy_m))))[:, 0]
        if block_count < 2:
            return [np.empty(0)] * len(estimates)

        # How often each block is drawn (resample, block).
        random = np.random.default_rng(self.seed)
        equal_probabilities = np.full(block_count, 1 / block_count)
        draws = random.multinomial(block_count, equal_probabilities, self.resamples)

        # The numbers on all resamples (m, resample), some resamples at a time.
        chunk_length = max(1, CHUNK // len(block))
        chunks = []
        for start in range(0, self.resamples, chunk_length):
            weight = draws[start : start + chunk_length, block].astype(np.float64)
            chunks.append(numbers(weight))
        resampled = np.concatenate(chunks, axis=1)

        defined = []
        for values, estimate in zip(resampled, estimates, strict=True):
            is_defined = ~np.isnan(values) & ~np.isnan(estimate)
            defined.append(values[is_defined])
        return defined


def bounds(resampled: NDArray[np.float64]) -> tuple[float, float]:
    """Lowest and highest of the 95 % interval of a number in resamples (r,); NaN without any."""
    if not len(resampled):
        return np.nan, np.nan
    low, high = np.percentile(resampled, BOUNDS)
    return float(low), float(high)


def blocks(xy_m: NDArray[np.float64], block_m: float) -> NDArray[np.int64]:
    """The block (q,) of each position (q, 2) of a path: `block_m` of travelled metres each.

    Blocks are numbered from 0 without gaps.
    """
    return np.unique(travelled_m(xy_m) // block_m, return_inverse=True)[1]
