"""Held-out blocks, and the threshold that is chosen on them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.matching.holdout import blocks, threshold_for


def along(n: int, step_m: float = 1.0) -> np.ndarray:
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = step_m * np.arange(n)
    return poses


def test_one_block_in_every_stretch_is_held_out() -> None:
    # Every 40 m, 4 m long, the first half a stretch in: rows 20 to 23, 60 to 63, 100 to 103 of one long place.
    held = blocks(along(120), np.zeros(120, np.int64), 40.0, 4.0)
    assert np.flatnonzero(held).tolist() == [*range(20, 24), *range(60, 64), *range(100, 104)]


def test_a_place_never_loses_its_last_row() -> None:
    # Rows 20 to 23 would go; 20 and 21 are all of place 1, 22 and 23 share place 2 with row 24.
    places = np.concatenate([np.zeros(20), [1, 1, 2, 2, 2], np.full(10, 3)]).astype(np.int64)
    assert np.flatnonzero(blocks(along(35), places, 40.0, 4.0)).tolist() == [22, 23]


@given(st.integers(1, 200), st.integers(1, 40), st.floats(1, 50), st.floats(0, 50), st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_whatever_is_held_out_every_place_is_trained(n: int, places: int, every_m: float, length_m: float, seed: int) -> None:
    place = np.random.default_rng(seed).integers(0, places, n)
    held = blocks(along(n), place, every_m, length_m)
    assert set(place[~held]) == set(place)


def test_path_is_measured_along_the_bends() -> None:
    # Up and down the same ten metres: 25 rows are 24 m of path, and 20 to 23 m of it are held out.
    poses = along(25)
    poses[:, 0, 3] = np.concatenate([np.arange(10), np.arange(8, 0, -1), np.arange(0, 7)])
    assert np.flatnonzero(blocks(poses, np.zeros(25, np.int64), 40.0, 4.0)).tolist() == [20, 21, 22, 23]


def chosen(precision: float, novelty: list[float], right: list[int], weight: list[float] | None = None) -> float:
    return threshold_for(precision, np.array(novelty), np.array(right, bool), np.array(weight or [1.0] * len(right)))


@pytest.mark.parametrize(
    ("precision", "accepted"),
    [
        (1.0, 2),  # right, right
        (0.7, 4),  # right, right, wrong, right: 3 of 4
        (0.6, 5),  # 3 of 5
        (0.5, 6),  # 3 of 6
        (0.0, 6),
    ],
)
def test_the_largest_threshold_that_keeps_the_precision_is_chosen(precision: float, accepted: int) -> None:
    novelty, right = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1, 1, 0, 1, 0, 0]
    threshold = chosen(precision, novelty, right)
    assert (np.array(novelty) < threshold).sum() == accepted


def test_precision_may_dip_and_recover() -> None:
    # wrong, then three right: 0, 1/2, 2/3, 3/4 of those accepted.
    assert chosen(0.75, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) > 0.4
    assert chosen(0.76, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) == 0.0


def test_equal_novelties_are_accepted_together() -> None:
    # At 0.2 there are a right one and a wrong one, in any order: accepting one accepts both, 2 of 3.
    for right in ([1, 1, 0], [1, 0, 1]):
        assert 0.1 < chosen(0.9, [0.1, 0.2, 0.2], right) <= 0.2
        assert chosen(0.66, [0.1, 0.2, 0.2], right) > 0.2


def test_an_unreachable_precision_accepts_nothing() -> None:
    assert chosen(0.95, [0.3, 0.4], [0, 1]) == 0.0
    assert chosen(0.95, [0.0, 0.0], [0, 1]) == 0.0
    assert chosen(0.95, [], []) == 0.0


def test_the_threshold_does_not_depend_on_the_order() -> None:
    assert chosen(0.7, [0.4, 0.1, 0.3, 0.2], [0, 1, 0, 1]) == chosen(0.7, [0.1, 0.2, 0.3, 0.4], [1, 1, 0, 0])


def test_a_query_counts_as_often_as_it_weighs() -> None:
    # Accepting all: 0.8 right of 0.8 + 0.2, a precision of 0.8.
    assert chosen(0.8, [0.1, 0.2], [1, 0], [0.8, 0.2]) > 0.2
    assert chosen(0.81, [0.1, 0.2], [1, 0], [0.8, 0.2]) <= 0.2
    # Unweighted it would be 0.5.
    assert chosen(0.8, [0.1, 0.2], [1, 0]) <= 0.2


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]), st.booleans()), min_size=1, max_size=12), st.floats(0.05, 1)
)
@settings(max_examples=60, deadline=None)
def test_no_larger_threshold_keeps_the_precision(queries: list[tuple[float, bool]], precision: float) -> None:
    novelty, right = np.array([n for n, _ in queries]), np.array([r for _, r in queries])
    threshold = threshold_for(precision, novelty, right, np.ones(len(right)))
    accepted = novelty < threshold
    assert not accepted.any() or right[accepted].mean() >= precision
    for larger in np.unique(novelty[~accepted]):
        assert right[novelty <= larger].mean() < precision
