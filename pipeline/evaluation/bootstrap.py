"""95 % intervals: how far a number moves with other stretches of the same streets."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.settings import Count, Positive, Seed, check

BOUNDS = (2.5, 97.5)
CHUNK = 1 << 17
"""Weights held at once: a MB in each array between, whatever the number of queries."""
Numbers = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # weights (r, q) to m numbers (m, r)


@dataclass(frozen=True)
class Bootstrap:
    """Resamples blocks of the path, not queries, since errors of neighbouring queries come in runs.

    Percentile method. A number that no resample moves, such as a recall of 1, has an interval of no
    width: the path holds no evidence of how it might fail.
    """

    block_m: Positive = 50.0
    """Travelled metres that stay together; longer than a run of errors."""
    resamples: Count = 1000
    seed: Seed = 0

    def __post_init__(self) -> None:
        check(self, "bootstrap")

    def intervals(self, numbers: Numbers, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lowest and highest (m, 2) of m numbers of queries along a path `xy_m` (q, 2).

        NaN for a number that all queries together leave undefined, and on a path of a single block;
        resamples that leave it undefined are left out.
        """
        return np.array(
            [bounds(spread) for spread in self.spreads(numbers, xy_m)], np.float64
        ).reshape(-1, 2)

    def estimates(self, numbers: Numbers, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The m numbers of all queries, each with its lowest and highest (m, 3)."""
        return np.concatenate(
            [numbers(np.ones((1, len(xy_m)))), self.intervals(numbers, xy_m)], axis=1
        )

    def spreads(self, numbers: Numbers, xy_m: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Each number in the resamples that define it; empty where `intervals` has NaN."""
        block = blocks(xy_m, self.block_m)
        estimate = numbers(np.ones((1, len(xy_m))))[:, 0]
        count = block.max(initial=-1) + 1
        if count < 2:
            return [np.empty(0)] * len(estimate)
        drawn_blocks = np.random.default_rng(self.seed).multinomial(
            count, np.full(count, 1 / count), self.resamples
        )
        step = max(1, CHUNK // len(block))
        chunks = [
            numbers(drawn_blocks[start : start + step, block].astype(np.float64))
            for start in range(0, self.resamples, step)
        ]
        resampled = np.concatenate(chunks, axis=1)
        return [
            spread[~np.isnan(spread) & ~np.isnan(value)]
            for spread, value in zip(resampled, estimate, strict=True)
        ]


def bounds(spread: NDArray[np.float64]) -> tuple[float, float]:
    """Lowest and highest of a number in resamples (r,); NaN without any."""
    low, high = np.percentile(spread, BOUNDS) if len(spread) else (np.nan, np.nan)
    return float(low), float(high)


def blocks(xy_m: NDArray[np.float64], block_m: float) -> NDArray[np.int64]:
    """The block (q,) of each position (q, 2) of a path: `block_m` of travelled metres each.

    Blocks are numbered from 0 without gaps.
    """
    travelled_m = np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0, prepend=xy_m[:1]), axis=1))
    return np.unique(travelled_m // block_m, return_inverse=True)[1]
