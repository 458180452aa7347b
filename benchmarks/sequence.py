"""SeqSLAM at 400 × 400 against a plain loop over the queries, and at 5,000 × 5,000 against copying
the matrix."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from benchmarks.race import Race, race
from pipeline.matching.patches import differences
from pipeline.matching.sequence import cheapest, contrast, runs, search

FEW = 400
PIXELS = 2_048
MANY = 5_000
HALF = 5
OFFSETS = runs(2 * HALF, 0.8, 1.2, 0.1)


def ours(
    references: NDArray[np.uint8], queries: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Enhanced differences, and the matched row of each query that has a whole sequence around
    it."""
    enhanced = contrast(differences(references, queries), 2 * HALF)
    enhanced -= enhanced.min()
    return enhanced, cheapest(np.ascontiguousarray(search(enhanced, OFFSETS).T), 1)[:, 0]


def loop_differences(
    references: NDArray[np.uint8], queries: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """A query at a time against all references."""
    known = references.astype(float)
    return np.stack([np.abs(known - query).sum(axis=1) / len(known) for query in queries], axis=1)


def loop_contrast(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """A reference at a time, its window's mean and deviation over all queries."""
    enhanced = np.empty_like(matrix)
    for i, row in enumerate(matrix):
        window = matrix[max(i - HALF, 0) : i + HALF + 1]
        enhanced[i] = (row - window.mean(axis=0)) / window.std(axis=0, ddof=1)
    enhanced -= enhanced.min()
    return enhanced


def loop_search(enhanced: NDArray[np.float64]) -> NDArray[np.int64]:
    """A query at a time, a first row at a time, all speeds at once (METHODS 6, step 4)."""
    n, m = enhanced.shape
    padded = np.vstack([enhanced, np.full(m, np.inf)])
    steps = OFFSETS + HALF
    length = np.arange(2 * HALF + 1)
    matched = []
    for query in range(HALF, m - HALF):
        columns = query - HALF + length
        costs = [
            padded[np.minimum(start + steps, n), columns].sum(axis=1).min() for start in range(n)
        ]
        matched.append(int(np.argmin(costs)) + HALF)
    return np.array(matched)


def plain(
    references: NDArray[np.uint8], queries: NDArray[np.uint8]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """What `ours` finds, by the three loops."""
    enhanced = loop_contrast(loop_differences(references, queries))
    return enhanced, loop_search(enhanced)


def drives() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """References and queries (FEW, PIXELS) at random, of which nearly a third of the pixels are the
    same."""
    rng = np.random.default_rng(0)
    references = rng.integers(0, 256, (FEW, PIXELS), dtype=np.uint8)
    return references, np.where(
        rng.random((FEW, PIXELS)) < 0.3,
        references,
        rng.integers(0, 256, (FEW, PIXELS), dtype=np.uint8),
    )


def run() -> list[Race]:
    """One thread, random images and differences: their values do not change the time."""
    rng = np.random.default_rng(1)
    (references, queries) = drives()
    (enhanced, matched) = ours(references, queries)
    (plain_enhanced, plainly) = plain(references, queries)
    if not np.allclose(enhanced, plain_enhanced, atol=1e-5) or not np.array_equal(matched, plainly):
        raise AssertionError("the matches differ from the plain loops'")
    matrix = differences(references, queries)
    taxi = cdist(references, queries, "cityblock") / FEW
    if not np.allclose(matrix, taxi):
        raise AssertionError("the differences differ from scipy's")
    large = rng.random((MANY, MANY), np.float32)
    copy = np.empty_like(large)
    return [
        race(
            f"SeqSLAM, {FEW} × {FEW} images of {PIXELS:,} pixels: differences, enhancement, "
            "search (matches equal)",
            {
                "yearloc": lambda _: ours(references, queries),
                "loops over the queries": lambda _: plain(references, queries),
            },
            rounds=1,
        ),
        race(
            f"the search alone, {FEW} × {FEW}",
            {
                "yearloc": lambda _: search(enhanced, OFFSETS).argmin(axis=0),
                "a loop over the queries": lambda _: loop_search(plain_enhanced),
            },
            rounds=1,
        ),
        race(
            f"sums of absolute differences, {FEW} × {FEW} images of {PIXELS:,} pixels (equal)",
            {
                "yearloc": lambda _: differences(references, queries),
                "numpy, a query at a time": lambda _: loop_differences(references, queries),
                "scipy cdist": lambda _: cdist(references, queries, "cityblock"),
            },
            rounds=5,
        ),
        race(
            f"enhancement and search, {MANY:,} × {MANY:,}",
            {
                "yearloc": lambda _: search(contrast(large, 2 * HALF), OFFSETS),
                "yearloc, the enhancement alone": lambda _: contrast(large, 2 * HALF),
                "memcpy of the matrix": lambda _: np.copyto(copy, large),
            },
            rounds=8,
        ),
    ]


if __name__ == "__main__":
    for result in run():
        print(result.table())
