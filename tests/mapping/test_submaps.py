"""Sampling along the path (METHODS 2.2), and the windows of submaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.mapping.submaps import Accumulated, SingleScan, sample_path

NAN = float("nan")


def path(*xs: float) -> np.ndarray:
    """Positions (n, 3) along x."""
    return np.column_stack([xs, np.zeros(len(xs)), np.zeros(len(xs))])


@pytest.mark.parametrize(
    ("xs", "rows"),
    [
        ((0, 0.5, 1, 1.5, 2), [2, 4]),  # 0.5 + 0.5, twice
        # 1.5 is enough, and the half metre too much is not carried over
        ((0, 0.75, 1.5, 2.25, 3), [2, 4]),
        ((0, 5, 5, 10), [1, 3]),  # one step, one sample, however long
        ((0, 0.5, 0, 0.5), [2]),  # back and forth is path too
        ((0, 0.25, 0.5, 0.75), []),
        ((0, 0, 0), []),
        ((3,), []),
        ((), []),
        ((NAN, 0, 1, 2), [2, 3]),  # the first rows have no pose
        # 0.5 before the gap and 0.5 after it; the 8.5 m across do not count
        ((0, 0.5, NAN, 9, 9.5), [4]),
        ((0, NAN, 100, NAN, 200), []),
        ((NAN, NAN), []),
    ],
)
def test_a_sample_is_taken_after_each_metre_of_path(xs: tuple[float, ...], rows: list[int]) -> None:
    assert sample_path(path(*xs), 1.0).tolist() == rows


def test_steps_are_measured_in_three_dimensions() -> None:
    # (1, 2, 2) is 3 m away; a step of 2.9 m would be enough, of 3.1 m not.
    steps = np.array([[0, 0, 0], [1, 2, 2.0]])
    assert sample_path(steps, 3.0).tolist() == [1]
    assert sample_path(steps, 3.1).tolist() == []


def poses(*xs: float) -> np.ndarray:
    """Poses (n, 4, 4) along x; a NaN is a pose that is not known."""
    found = np.tile(np.eye(4), (len(xs), 1, 1))
    found[:, 0, 3] = xs
    found[np.isnan(xs)] = np.nan
    return found


def windows(
    *xs: float, placed: np.ndarray | None = None, window_m: float = 2.0
) -> tuple[list[int], list[int], dict[str, int]]:
    ground_truth = poses(*np.arange(float(len(xs)))) if placed is None else placed
    first, last, left_out = Accumulated(step_m=1.0, window_m=window_m).windows(
        poses(*xs), ground_truth
    )
    return first.tolist(), last.tolist(), +left_out


def test_a_window_reaches_back_over_its_length_of_odometry() -> None:
    # Anchors at 1, 2, 3, 4 m; the first with 2 m behind it is at 2 m.
    assert windows(0, 1, 2, 3, 4) == ([0, 1, 2], [2, 3, 4], {"window not yet whole": 1})
    assert windows(0, 0.5, 1, 1.5, 2, 2.5, 3) == ([0, 2], [4, 6], {"window not yet whole": 1})


def test_no_window_reaches_across_a_break_in_the_odometry() -> None:
    # After the break the path is counted again: 10, 11, 12 is the first whole window.
    assert windows(0, 1, 2, NAN, 10, 11, 12, 13) == (
        [0, 4, 5],
        [2, 6, 7],
        {"window not yet whole": 2},
    )
    assert windows(NAN, 0, 1, 2) == ([1], [3], {"window not yet whole": 1})


def test_an_anchor_without_a_place_makes_no_submap_but_its_scans_serve_others() -> None:
    placed = poses(0, 1, NAN, 3, 4)
    assert windows(0, 1, 2, 3, 4, placed=placed) == (
        [1, 2],
        [3, 4],
        {"window not yet whole": 1, "no true pose": 1},
    )


@given(st.lists(st.one_of(st.floats(-50, 50), st.just(NAN)), max_size=60), st.floats(0.5, 20))
@settings(max_examples=60)
def test_a_window_is_unbroken_and_the_shortest_that_is_long_enough(
    xs: list[float], window_m: float
) -> None:
    first, last, left_out = windows(*xs, window_m=window_m)
    steps = np.abs(np.diff(xs))
    assert len(last) + sum(left_out.values()) == len(sample_path(path(*xs), 1.0))
    for a, b in zip(first, last, strict=True):
        assert np.isfinite(xs[a : b + 1]).all()
        assert steps[a:b].sum() <= window_m + 1e-6
        assert a == 0 or np.isnan(xs[a - 1]) or steps[a - 1 : b].sum() > window_m - 1e-6


def test_a_scan_is_its_own_submap() -> None:
    assert SingleScan().anchors(poses(0, 0.5, 1, 1.5, 2)).tolist() == [2, 4]


def test_a_step_of_zero_takes_every_scan() -> None:
    assert SingleScan(0.0).anchors(poses(0, 0, 1, 5)).tolist() == [0, 1, 2, 3]
