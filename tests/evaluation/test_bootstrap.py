"""Tests of the 95 % intervals, which come from resampled blocks of the path."""

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation import bootstrap
from pipeline.evaluation.bootstrap import Bootstrap, blocks

Numbers = Callable[[np.ndarray], np.ndarray]


def straight(metres: int) -> np.ndarray:
    """A path with a query at every metre."""
    return np.stack([np.arange(metres, dtype=float), np.zeros(metres)], axis=1)


def share_of(right: np.ndarray) -> Numbers:
    """The share of queries that are right: one number (1, r) of weights (r, q)."""
    return lambda weight: (weight @ right / weight.sum(axis=1))[None]


def test_blocks_are_metres_travelled_and_not_metres_away() -> None:
    # 0 … 49 m, 50 … 99 m, 100 … 119 m
    assert np.bincount(blocks(straight(120), 50.0)).tolist() == [
        50,
        50,
        20,
    ]
    out = straight(60)
    back = straight(60)[::-1]
    # One query turns on the spot
    assert np.bincount(blocks(np.concatenate([out, back]), 50.0)).tolist() == [
        50,
        51,
        19,
    ]
    standing = np.zeros((5, 2))
    assert blocks(standing, 50.0).tolist() == [0] * 5
    gap = np.concatenate([straight(10), straight(10) + 1000.0])
    assert np.bincount(blocks(gap, 50.0)).tolist() == [10, 10]  # which leaves no empty block


def test_the_queries_of_a_block_stay_together() -> None:
    seen: list[np.ndarray] = []

    def numbers(weight: np.ndarray) -> np.ndarray:
        seen.append(weight)
        return weight.sum(axis=1)[None]

    Bootstrap(block_m=50.0, resamples=20).intervals(numbers, straight(150))
    weight = np.concatenate(seen[1:])  # the first call is the estimate's, all ones
    assert (seen[0] == 1).all()
    assert weight.shape == (20, 150)
    assert (weight == weight[:, [0, 50, 100]].repeat(50, axis=1)).all()
    assert (weight[:, [0, 50, 100]].sum(axis=1) == 3).all()  # as many blocks as there are
    assert len(np.unique(weight, axis=0)) > 1


def test_the_bounds_are_percentiles_of_the_resampled_numbers() -> None:
    # Two blocks of 50 m, one all right and one all wrong. Both drawn wrong, one of each, both
    # right: shares 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4, so the 2.5 % percentile is 0 and the
    # 97.5 % one 1.
    right = np.arange(100) < 50
    np.testing.assert_allclose(Bootstrap().intervals(share_of(right), straight(100)), [[0.0, 1.0]])


def test_the_same_seed_gives_the_same_intervals_whatever_is_held_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = np.random.default_rng(0).random(700) < 0.6
    first = Bootstrap(resamples=100).intervals(share_of(right), straight(700))
    monkeypatch.setattr(bootstrap, "CHUNK", 1)
    assert (Bootstrap(resamples=100).intervals(share_of(right), straight(700)) == first).all()
    assert (
        Bootstrap(resamples=100, seed=1).intervals(share_of(right), straight(700)) != first
    ).all()


def test_resamples_that_leave_a_number_undefined_are_left_out_and_where_all_do_there_is_no_interval() -> (
    None
):
    # Only the first of three blocks holds what the number is of; two resamples in seven or so never
    # draw it.
    def numbers(weight: np.ndarray) -> np.ndarray:
        return np.stack([np.where(weight[:, 0] > 0, 0.25, np.nan), np.full(len(weight), np.nan)])

    intervals = Bootstrap(resamples=50).intervals(numbers, straight(150))
    assert intervals[0].tolist() == [0.25, 0.25]
    assert np.isnan(intervals[1]).all()

    def of_all_once(weight: np.ndarray) -> np.ndarray:
        return np.where((weight == 1).all(axis=1), 0.5, np.nan)[None]  # as the estimate is

    def of_others(weight: np.ndarray) -> np.ndarray:
        # Defined in resamples that draw the first block twice or never
        return np.where(weight[:, :1].T == 1, np.nan, 0.5)

    assert np.isnan(Bootstrap(resamples=3, seed=1).intervals(of_all_once, straight(1000))).all()
    assert np.isnan(Bootstrap(resamples=50).intervals(of_others, straight(150))).all()


@pytest.mark.parametrize("metres", [0, 1, 50])
def test_a_single_block_tells_nothing_of_the_spread(metres: int) -> None:
    assert np.isnan(
        Bootstrap().intervals(lambda weight: np.zeros((1, len(weight))), straight(metres))
    ).all()


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"bootstrap.block_m=0.0: expected a number above 0"):
        Bootstrap(block_m=0.0)
    with pytest.raises(ConfigError, match=r"bootstrap.resamples=1.5: expected a whole number"):
        Bootstrap(resamples=1.5)  # type: ignore[arg-type]


def in_runs(
    rng: np.random.Generator, drives: int, metres: int, share: float, run_m: float
) -> np.ndarray:
    """Whether each query (drive, metre) is right: it stays as it was, or with probability 1/run_m
    is drawn again."""
    fresh = rng.random((drives, metres)) < share
    last = np.maximum.accumulate(
        np.where(rng.random((drives, metres)) < 1 / run_m, np.arange(metres), 0), axis=1
    )
    return np.take_along_axis(fresh, last, axis=1)


def test_an_interval_holds_the_ground_truth_where_errors_come_in_runs_and_single_queries_do_not() -> (
    None
):
    # 150 drives of 1.5 km, 70 % right, right and wrong in runs of 10 m and more.
    right = in_runs(np.random.default_rng(0), 150, 1500, 0.7, 10.0)
    xy_m = straight(1500)

    def covered(block_m: float) -> float:
        low, high = (
            Bootstrap(block_m, resamples=200)
            .intervals(lambda weight: right @ weight.T / weight.sum(axis=1), xy_m)
            .T
        )
        return float(((low <= 0.7) & (high >= 0.7)).mean())

    assert 0.88 <= covered(50.0) <= 0.99
    assert covered(1.0) < 0.5
