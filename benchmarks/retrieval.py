"""Retrieval among 5,000 training scans, one query at a time: ours against plain numpy, faiss, and
reading what must be read."""

import faiss
import numpy as np
from numpy.typing import NDArray

from benchmarks.race import Race, race
from pipeline.matching.nearest import nearest
from pipeline.matching.shift_method import ring_keys
from pipeline.matching.shifts import Spectra

ROWS = 5_000
RINGS = 40
SECTORS = 120
QUERIES = 64
CANDIDATES = 50
WIDTH = 256
K = 25


def scan_contexts(number: int, blind: int = 60) -> NDArray[np.float32]:
    """Heights as sparse as a 3-D scanner's: a run of up to `blind` sectors sees nothing, far rings
    see little."""
    rng = np.random.default_rng(0)
    seen = rng.random((number, RINGS, SECTORS)) < np.linspace(0.3, 0.02, RINGS)[:, None]
    away = (np.arange(SECTORS) - rng.integers(0, SECTORS, (number, 1))) % SECTORS < rng.integers(
        0, max(blind, 1), (number, 1)
    )
    heights: NDArray[np.float32] = rng.gamma(2.0, 2.0, seen.shape).astype(np.float32) * (
        seen & ~away[:, None]
    )
    return heights


def distance(query: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """The definition (METHODS 1.3) with numpy, a shift at a time."""
    best = -np.inf
    lengths = np.linalg.norm(query, axis=0)
    for shift in range(SECTORS):
        rolled = np.roll(other, -shift, axis=1)
        both = lengths * np.linalg.norm(rolled, axis=0)
        engaged = both > 0
        if engaged.any():
            best = max(best, float(((query * rolled).sum(axis=0)[engaged] / both[engaged]).mean()))
    return 1 - best if np.isfinite(best) else 1.0


def run() -> list[Race]:
    """Scan Context-50, the exhaustive search, and the neighbour search under all descriptor
    methods."""
    threads = faiss.omp_get_max_threads()
    faiss.omp_set_num_threads(1)
    try:
        return [*_shifts(), _neighbours()]
    finally:
        faiss.omp_set_num_threads(threads)


def _shifts() -> list[Race]:
    heights = scan_contexts(ROWS + QUERIES)
    queries = heights[ROWS:]
    heights = heights[:ROWS]
    spectra = Spectra.learned(heights)
    keys = ring_keys(heights)
    everything = np.arange(ROWS)

    def shortlist(i: int) -> NDArray[np.int64]:
        rows: NDArray[np.int64] = nearest(keys, ring_keys(queries[i % QUERIES, None]), CANDIDATES)[
            1
        ][0]
        return rows

    def fifty(i: int) -> NDArray[np.float64]:
        return spectra.compare(queries[i % QUERIES], shortlist(i))[0]

    def loop(i: int) -> list[float]:
        return [distance(queries[i % QUERIES], heights[row]) for row in shortlist(i)]

    def exhaustive(i: int) -> NDArray[np.float64]:
        return spectra.compare(queries[i % QUERIES], everything)[0]

    for i in range(2):
        if not np.allclose(fifty(i), loop(i), atol=1e-6) or not np.array_equal(
            exhaustive(i)[shortlist(i)], fifty(i)
        ):
            raise AssertionError("the distances differ from the definition's")
    copy = np.empty_like(spectra.columns)
    return [
        race(
            f"Scan Context-50: {CANDIDATES} of {ROWS:,} by ring key, then all {SECTORS} shifts "
            "(distances equal within 1e-6)",
            {"yearloc": fifty, "the ring keys alone": shortlist},
            rounds=200,
        ),
        race("the same", {"yearloc": fifty, "numpy, a shift at a time": loop}, rounds=10),
        race(
            f"Scan Context, all {ROWS:,} at all shifts, {spectra.columns.nbytes / 1e6:.0f} MB of "
            "spectra",
            {
                "yearloc": exhaustive,
                "the sum of the spectra": lambda _: spectra.columns.sum(),
                "memcpy of the spectra": lambda _: np.copyto(copy, spectra.columns),
            },
        ),
    ]


def _neighbours() -> Race:
    rng = np.random.default_rng(0)
    database, queries = (rng.normal(size=(n, WIDTH)).astype(np.float32) for n in (ROWS, QUERIES))
    flat = faiss.IndexFlatL2(WIDTH)
    flat.add(database)
    squares = (database**2).sum(axis=1)

    def argpartition(i: int) -> NDArray[np.int64]:
        far = squares - 2 * (database @ queries[i % QUERIES])
        found = np.argpartition(far, K)[:K]
        rows: NDArray[np.int64] = found[np.argsort(far[found])]
        return rows

    for i, query in enumerate(queries):
        ours = nearest(database, query[None], K)[1][0]
        if not np.array_equal(ours, flat.search(query[None], K)[1][0]) or not np.array_equal(
            ours, argpartition(i)
        ):
            raise AssertionError("the neighbours differ")
    return race(
        f"the {K} nearest of {ROWS:,} descriptors of {WIDTH} numbers (rows equal)",
        {
            "yearloc": lambda i: nearest(database, queries[i % QUERIES, None], K),
            "faiss IndexFlatL2": lambda i: flat.search(queries[i % QUERIES, None], K),
            "numpy argpartition": argpartition,
        },
        rounds=200,
    )
