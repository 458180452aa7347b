"""Means of points in voxels, against numpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.views.kernels import voxel_means


def reference(points: np.ndarray, side_m: float) -> np.ndarray:
    """Means of the points in each cube, in order of the cubes' first points."""
    wide = points.astype(np.float64)
    cubes = np.floor((wide - wide.min(axis=0)) / side_m).astype(np.int64)
    _, first, cube = np.unique(cubes, axis=0, return_index=True, return_inverse=True)
    sums = np.stack([np.bincount(cube.ravel(), axis) for axis in wide.T], axis=1)
    return (sums / np.bincount(cube.ravel())[:, None])[np.argsort(first)]


def test_points_of_one_cube_become_their_mean() -> None:
    # The grid starts at the lowest corner (0, 0, −1): x 0.4 is in the first cube of 0.5 m, 0.5 in
    # the second.
    points = np.array([[0.5, 0, 0], [0, 0, -1.0], [0.4, 0.2, -0.6]])
    np.testing.assert_allclose(voxel_means(points, 0.5), [[0.5, 0, 0], [0.2, 0.1, -0.8]])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@given(
    st.integers(0, 2**32),
    st.integers(1, 3000),
    st.sampled_from([0.1, 0.5, 2.0, 100.0]),
    st.floats(0.5, 200),
)
@settings(max_examples=15)
def test_means_are_those_of_numpy(
    dtype: type, seed: int, n: int, side_m: float, reach_m: float
) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 3), scale=reach_m / 3).astype(dtype)
    np.testing.assert_allclose(
        voxel_means(points, side_m), reference(points, side_m), rtol=1e-12, atol=1e-12
    )
