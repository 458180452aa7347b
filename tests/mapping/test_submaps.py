"""Sampling along the path (METHODS 2.2)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import ConfigError
from pipeline.mapping.submaps import SingleScan, sample_path

NAN = float("nan")


def path(*xs: float) -> np.ndarray:
    """Positions along x."""
    return np.column_stack([xs, np.zeros(len(xs)), np.zeros(len(xs))])


@pytest.mark.parametrize(
    ("xs", "rows"),
    [
        ((0, 0.5, 1, 1.5, 2), [2, 4]),  # 0.5 + 0.5, twice
        ((0, 0.75, 1.5, 2.25, 3), [2, 4]),  # 1.5 is enough, and the half metre too much is not carried over
        ((0, 5, 5, 10), [1, 3]),  # one step, one sample, however long
        ((0, 0.5, 0, 0.5), [2]),  # back and forth is path too
        ((0, 0.25, 0.5, 0.75), []),
        ((0, 0, 0), []),
        ((3,), []),
        ((), []),
        ((NAN, 0, 1, 2), [2, 3]),  # the first rows have no pose
        ((0, 0.5, NAN, 9, 9.5), [4]),  # 0.5 before the gap and 0.5 after it; the 8.5 m across do not count
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


@given(st.lists(st.one_of(st.floats(-50, 50), st.just(NAN)), max_size=40), st.floats(0.1, 20))
@settings(max_examples=40, deadline=None)
def test_samples_are_known_and_at_least_a_step_of_path_apart(xs: list[float], step_m: float) -> None:
    rows = sample_path(path(*xs), step_m)
    steps = np.abs(np.diff(xs)) if len(xs) > 1 else np.empty(0)
    travelled = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(steps), steps, 0.0))])
    assert np.isfinite(np.array(xs)[rows]).all()
    assert (np.diff(travelled[np.concatenate([[0], rows]).astype(int)]) >= step_m - 1e-9).all()


def test_a_scan_is_its_own_submap() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, 3] = path(0, 0.5, 1, 1.5, 2)
    assert SingleScan().anchors(poses).tolist() == [2, 4]


def test_a_step_of_zero_takes_every_scan() -> None:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = [0, 0, 1, 5]
    assert SingleScan(0.0).anchors(poses).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("step_m", [-1.0, NAN])
def test_a_step_that_is_no_length_is_a_config_error(step_m: float) -> None:
    with pytest.raises(ConfigError, match="step_m"):
        SingleScan(step_m)
