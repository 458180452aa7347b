"""The kernels of SeqSLAM's search, against the official code's numbers and plain loops."""

import numpy as np
import pytest

from pipeline.matching import sequence
from pipeline.matching.sequence import (
    cheapest,
    enhance_contrast,
    least_contrast,
    runner_up,
    runs,
    search,
)

SPEEDS = (0.8, 1.2, 0.1)
"""Slowest and fastest speed, and the step between speeds."""


def official() -> np.ndarray:
    """The difference matrix (40, 30) of METHODS 6, for whose results the official code was run."""
    i = np.arange(40)[:, None]
    j = np.arange(30)
    return np.asarray((i**2 + 3 * i * j + 7 * j) % 23 + 5 * np.abs(i - j - 4), np.float32)


def plain_contrast(differences: np.ndarray, half: int) -> np.ndarray:
    """`enhance_contrast` with windows of ± `half` rows, in numpy's float64."""
    out = np.zeros(differences.shape)
    for i in range(len(differences)):
        window = differences[max(i - half, 0) : i + half + 1].astype(np.float64)
        if len(window) > 1:
            spread = window.std(axis=0, ddof=1)
            out[i] = np.where(
                spread > 0,
                (differences[i] - window.mean(axis=0)) / np.where(spread > 0, spread, 1),
                0,
            )
    return out


def plain_search(enhanced: np.ndarray, length: int, moves: list[int]) -> np.ndarray:
    """Costs (n, windows) by the definition (METHODS 6, step 4), of runs by their first row.

    `moves` are speeds in tenths of a row. Rows beyond the last one cost +inf.
    """
    n, m = enhanced.shape
    padded = np.vstack([enhanced, np.full((1, m), np.inf)])
    costs = np.full((n, m - length), np.inf)
    for window in range(m - length):
        for start in range(n):
            costs[start, window] = min(
                sum(padded[min(start + k * move // 10, n), window + k] for k in range(length + 1))
                for move in moves
            )
    return costs


def test_the_official_code_s_enhanced_differences_matches_and_ratios() -> None:
    enhanced = enhance_contrast(official(), 10)
    enhanced -= enhanced.min()
    assert enhanced.dtype == np.float32
    np.testing.assert_allclose(
        enhanced[[0, 19, 39], [0, 15, 29]], [3.528037, 0.848247, 3.915999], atol=1e-6
    )
    np.testing.assert_allclose(
        [enhanced.sum(dtype=float), enhanced.max()], [2744.008, 4.040952], atol=1e-3
    )
    costs = search(enhanced, runs(10, *SPEEDS)).T
    assert costs.shape == (20, 40)  # 30 queries, 10 of which are too near an end
    best = cheapest(costs, 1)[:, 0]
    ratios = costs[np.arange(20), best] / runner_up(costs, best, 10)
    queries = np.array([5, 6, 14, 15, 23, 24]) - 5
    np.testing.assert_array_equal(best[queries], [10, 10, 18, 20, 27, 29])
    np.testing.assert_allclose(
        ratios[queries], [0.491714, 0.486685, 0.440005, 0.509527, 0.559607, 0.556489], atol=1e-6
    )


@pytest.mark.parametrize("rows", [2, 10, 11, 30])
def test_contrast_is_each_column_s_own_in_a_window_that_ends_with_the_rows(rows: int) -> None:
    differences = np.random.default_rng(0).random((37, 5)).astype(np.float32)
    np.testing.assert_allclose(
        enhance_contrast(differences, rows), plain_contrast(differences, rows // 2), atol=2e-6
    )


def test_running_sums_do_not_drift() -> None:
    # Float32 sums of a million and a few would be off by their last digit, 0.06, each time that one
    # is added or taken off.
    differences = (1e6 + np.random.default_rng(0).normal(0, 50, (3_000, 3))).astype(np.float32)
    np.testing.assert_allclose(
        enhance_contrast(differences, 10), plain_contrast(differences, 5), atol=1e-5
    )


def test_columns_beyond_a_block_are_as_the_first() -> None:
    differences = np.random.default_rng(0).random((15, 7)).astype(np.float32)
    wide = np.tile(differences, (1, 300))  # 2,100 columns
    assert wide.shape[1] > sequence.BLOCK
    np.testing.assert_array_equal(
        enhance_contrast(wide, 10), np.tile(enhance_contrast(differences, 10), (1, 300))
    )
    costs = search(wide, runs(3, *SPEEDS))
    assert costs.shape[1] > sequence.BLOCK
    np.testing.assert_array_equal(costs[:, 7:], costs[:, :-7])


def test_what_does_not_vary_has_no_contrast_and_the_least_is_one_low_value_among_equals() -> None:
    assert not enhance_contrast(np.full((9, 2), 0.1, np.float32), 4).any()
    assert not enhance_contrast(np.full((1, 2), 3.0, np.float32), 10).any()
    assert enhance_contrast(np.empty((0, 2), np.float32), 10).shape == (0, 2)
    column = np.full((30, 1), 9.0, np.float32)
    column[15] = 1
    # (1 − 91 / 11) / √(64 · 10/11 / 10) = −10 / √11
    assert enhance_contrast(column, 10)[15, 0] == pytest.approx(least_contrast(10))
    assert least_contrast(10) == pytest.approx(-10 / 11**0.5)


def test_a_run_is_counted_from_its_middle_in_whole_rows() -> None:
    offsets = runs(10, *SPEEDS)
    assert offsets.shape == (5, 11)
    np.testing.assert_array_equal(offsets[0] + 5, [0, 0, 1, 2, 3, 4, 4, 5, 6, 7, 8])
    np.testing.assert_array_equal(offsets[2], np.arange(-5, 6))
    np.testing.assert_array_equal(offsets[4] + 5, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 12])
    assert runs(100, 0.57, 0.57, 0.1)[0, -1] == 57 - 50  # in floats 0.57 · 100 lies below 57
    np.testing.assert_array_equal(runs(0, *SPEEDS), np.zeros((5, 1)))


@pytest.mark.parametrize("length", [10, 4, 3, 0])
def test_search_finds_what_a_plain_loop_finds(length: int) -> None:
    enhanced = np.random.default_rng(0).normal(size=(23, 19)).astype(np.float32)
    plain = plain_search(enhanced, length, [8, 9, 10, 11, 12])
    half = length // 2
    costs = search(enhanced, runs(length, *SPEEDS))
    np.testing.assert_allclose(costs[half:], plain[: 23 - half], atol=1e-5)
    assert np.isinf(costs[:half]).all()
    np.testing.assert_array_equal(search(enhanced, runs(length, *SPEEDS), 3, 6), costs[:, 3:6])


def test_a_run_driven_backwards_is_the_mirrored_one() -> None:
    enhanced = np.random.default_rng(0).normal(size=(23, 19)).astype(np.float32)
    offsets = runs(10, *SPEEDS)
    np.testing.assert_array_equal(
        search(enhanced, -offsets), search(np.ascontiguousarray(enhanced[::-1]), offsets)[::-1]
    )


def test_the_first_of_equally_cheap_rows_comes_first_and_the_runner_up_lies_elsewhere() -> None:
    costs = np.array([[2, -1, np.inf, 0, -0.0, -1, -3]], np.float32)
    for k in (1, 2, 4, 7, 9):
        np.testing.assert_array_equal(cheapest(costs, k), [[6, 1, 5, 3, 4, 0, 2][:k]])
    many = np.random.default_rng(0).integers(-3, 3, (20, 200)).astype(np.float32)
    np.testing.assert_array_equal(cheapest(many, 50), many.argsort(axis=1, kind="stable")[:, :50])
    assert cheapest(costs[:0], 3).shape == (0, 3)
    costs = np.array([[5, 4, 1, 2, 3, 6, 7]], np.float32)
    assert runner_up(costs, np.array([2]), 2) == 3  # rows 1 to 3 are beside the best
    assert runner_up(costs, np.array([2]), 5) == 6
    assert np.isinf(runner_up(costs, np.array([2]), 10))
