"""Tests of the line through a number over the days since training, and of the day on which the
number has fallen too far."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation.ageing import Ageing, Line, newness
from tests.evaluation.made import evaluation

DAYS = np.array([0, 100, 200, 300])
VALUES = np.array([1.0, 0.9, 0.7, 0.6])
"""Means 150 and .8; Sxx = 50,000, Sxy = −70: slope −.0014, intercept 1.01.

Residuals −.01 .03 −.03 .01: squares .002, so s² = .001 with 2 degrees of freedom, and the slope's
variance .001 / 50,000 = 2e−8.
"""
T_2 = 4.302653
"""Student's t: 97.5 % with 2 degrees of freedom."""


def line(values: np.ndarray = VALUES, days: np.ndarray = DAYS) -> Line:
    result = Ageing().line(days, values)
    assert result is not None
    return result


def test_the_line_is_the_one_of_least_squares_and_the_interval_of_its_slope_is_students() -> None:
    assert (line().intercept, line().slope) == (pytest.approx(1.01), pytest.approx(-0.0014))
    assert line().sequence_count == 4
    half = T_2 * np.sqrt(2e-8)
    assert line().interval == pytest.approx((-0.0014 - half, -0.0014 + half))
    assert line().trend == -1
    narrow = Ageing(level=0.5).line(DAYS, VALUES)
    assert narrow is not None
    assert narrow.interval == pytest.approx(
        (-0.0014 - 0.816497 * np.sqrt(2e-8), -0.0014 + 0.816497 * np.sqrt(2e-8))
    )


def test_the_line_is_least_sure_away_from_the_sequences() -> None:
    # s² (1/4 + (d − 150)² / 50,000): .00025 in the middle, .0007 at day 0
    value, low, high = line().at(np.array([150, 0]))
    assert value == pytest.approx([0.8, 1.01])
    assert value - low == pytest.approx(T_2 * np.sqrt([0.00025, 0.0007]))
    assert high - value == pytest.approx(value - low)


def test_a_tenth_is_lost_where_the_line_says_within_fiellers_interval() -> None:
    # .101 / .0014 = 72.14 days. Fieller: (.101 − .0014 d)² = t² (.01 · 7e−4 − .2 · 3e−6 d + 2e−8
    # d²), t² = 18.5128, so 1.589744e−6 d² − 2.7169229e−4 d + .01007141 = 0, whose roots are 54.359
    # and 116.544.
    assert line().lost(0.1) == pytest.approx((72.142857, 54.35923, 116.54399), rel=1e-6)


def test_on_the_line_nothing_is_uncertain_and_no_day_is_given_unless_it_surely_falls() -> None:
    exact = line(1.0 - 0.001 * DAYS)
    assert exact.lost(0.2) == pytest.approx((200, 200, 200))
    assert exact.interval == pytest.approx((-0.001, -0.001))
    level = line(np.full(4, 0.7))
    assert (level.interval, level.trend, level.lost(0.1)) == ((0.0, 0.0), 0, None)
    up_and_down = line(np.array([0.8, 0.7, 0.8, 0.75]))
    rising = line(VALUES[::-1])
    assert (up_and_down.trend, up_and_down.lost(0.1)) == (0, None)
    assert (rising.trend, rising.lost(0.1)) == (1, None)


def test_one_odd_sequence_hardly_moves_the_middle_slope() -> None:
    # Slopes between pairs of (0, 1), (100, .9), (200, .8), (300, 0): −.001 thrice, else −8, −4.5
    # and −3.3 thousandths; the median is between −.001 and −.00333
    odd = line(np.array([1.0, 0.9, 0.8, 0.0]))
    assert odd.middle_slope == pytest.approx(-(0.001 + 1 / 300) / 2)
    assert odd.slope == pytest.approx(-0.0031)


def test_two_sequences_give_a_slope_but_no_interval_and_one_gives_none() -> None:
    two = line(VALUES[:2], DAYS[:2])
    assert two.slope == pytest.approx(-0.001)
    assert (two.interval, two.trend, two.lost(0.1)) == (None, 0, None)
    assert np.isnan(two.p)
    assert Ageing().line(DAYS[:1], VALUES[:1]) is None
    assert Ageing().line(np.array([20, 20]), VALUES[:2]) is None  # both of one day
    # One without the number is left out
    result = line(np.append(VALUES, np.nan), np.append(DAYS, 400))
    assert (result.sequence_count, result.slope) == (4, pytest.approx(-0.0014))


def test_intervals_hold_the_true_slope_and_the_true_day_as_often_as_they_say() -> None:
    rng = np.random.default_rng(0)
    days = np.array([20, 62, 152, 287, 446])
    lines = [line(0.8 - 0.0004 * days + rng.normal(0, 0.015, 5), days) for _ in range(300)]
    slope_held = [
        low <= -0.0004 <= high for low, high in (one.interval or (1.0, 0.0) for one in lines)
    ]
    day_held = [
        first <= 200 <= last
        for _, first, last in (one.lost(0.1) or (0.0, 300.0, 0.0) for one in lines)
    ]
    assert np.mean(slope_held) == pytest.approx(0.95, abs=0.03)
    assert np.mean(day_held) == pytest.approx(0.95, abs=0.03)


def test_newness_is_where_the_median_seen_novelty_lies_among_the_validation() -> None:
    # By distance, the first five are seen; their median entropy is .2. Below it 3 of 4 validation
    # ones, or 2 and a tie.
    one = evaluation()
    assert newness(one, np.array([0.1, 0.15, 0.19, 0.3])) == 75
    assert newness(one, np.array([0.1, 0.15, np.float64(np.float32(0.2)), 0.3])) == 62.5
    assert np.isnan(newness(one, np.empty(0)))
    nothing = replace(one, judgements=(one.cells, replace(one.distance, seen=np.zeros(7, bool))))
    assert np.isnan(newness(nothing, np.array([0.1])))


@pytest.mark.parametrize(("name", "value"), [("loss", 0.0), ("loss", 1.0), ("level", 95.0)])
def test_settings_are_shares(name: str, value: float) -> None:
    with pytest.raises(
        ConfigError, match=rf"ageing\.{name}={value}: expected a share between 0 and 1"
    ):
        Ageing(**{name: value})
