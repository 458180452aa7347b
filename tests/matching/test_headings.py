"""Distances of queries, with one code each, to places with a code at each of several headings."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.matching.headings import PLACES, nearest_heading, reference_headings


def random_codes(n: int, m: int, width: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Random codes (n, 8, width) of places at eight headings, and of queries (m, width)."""
    rng = np.random.default_rng(0)
    codes = rng.normal(size=(n, 8, width)).astype(np.float16)
    queries = rng.normal(size=(m, width)).astype(np.float32)
    return codes, queries


def test_the_distance_is_the_least_over_the_headings_of_equal_ones_the_first() -> None:
    codes, queries = random_codes(PLACES + 3, 5)
    expected = np.linalg.norm(codes[:, :, None].astype(float) - queries, axis=3)
    distances, headings = nearest_heading(codes, queries)
    assert distances.dtype == np.float32
    assert headings.dtype == np.uint8
    np.testing.assert_allclose(distances, expected.min(axis=1), rtol=1e-5)
    np.testing.assert_array_equal(headings, expected.argmin(axis=1))
    codes = np.repeat(random_codes(4, 1)[0][:, :1], 8, axis=1)
    assert not nearest_heading(codes, codes[:, 0].astype(np.float32))[1].any()


def test_reference_headings_are_even_ones_evenly_around_the_circle() -> None:
    views = np.arange(16)
    assert views[reference_headings(16, 8)].tolist() == [0, 2, 4, 6, 8, 10, 12, 14]
    assert views[reference_headings(16, 4)].tolist() == [0, 4, 8, 12]
    assert views[reference_headings(16, 2)].tolist() == [0, 8]
    assert views[reference_headings(16, 1)].tolist() == [0]
    assert np.arange(8)[reference_headings(8, 8)].tolist() == [0, 2, 4, 6]
    assert np.arange(24)[reference_headings(24, 8)].tolist() == [*range(0, 24, 2)]
    assert np.arange(3)[reference_headings(3, 1)].tolist() == [0]


def test_codes_that_lie_close_together_far_from_zero_are_distinguished() -> None:
    # As a collapsed network's do: lengths of 570, distances of about 0.8.
    codes, queries = random_codes(30, 6)
    codes = 100 + codes.astype(np.float32) / 10
    queries = 100 + queries / 10
    expected = np.linalg.norm(codes[:, :, None].astype(float) - queries, axis=3).min(axis=1)
    np.testing.assert_allclose(nearest_heading(codes, queries)[0], expected, rtol=1e-4)


def test_one_query_is_answered_as_in_a_crowd_and_none_at_all() -> None:
    codes, queries = random_codes(20, 5)
    distances, headings = nearest_heading(codes, queries)
    alone, headings_alone = nearest_heading(codes, queries[3:4])
    np.testing.assert_allclose(alone[:, 0], distances[:, 3], rtol=1e-5)
    np.testing.assert_array_equal(headings_alone[:, 0], headings[:, 3])
    assert nearest_heading(codes, queries[:0])[0].shape == (20, 0)


def test_codes_of_another_width_are_refused() -> None:
    codes, queries = random_codes(3, 2)
    with pytest.raises(InputError, match=r"\(2, 31\): expected \(m, d\)"):
        nearest_heading(codes, queries[:, :31])
