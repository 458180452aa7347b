"""Validation blocks of a training path: which rows they hold, and how they are numbered."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.matching.holdout import blocks, number_blocks
from tests.matching import made


def along(n: int) -> np.ndarray:
    """Poses (n, 4, 4), a metre apart along x."""
    return made.along(np.empty(n)).world_T_anchor


def test_one_block_in_every_stretch_of_the_path_along_its_bends_is_validation() -> None:
    # Every 40 m, 4 m long, the first half a stretch in: rows 20 to 23, 60 to 63, 100 to 103 of one
    # long place.
    is_validation = blocks(along(120), np.zeros(120, np.int64), 40.0, 4.0)
    assert np.flatnonzero(is_validation).tolist() == [
        *range(20, 24),
        *range(60, 64),
        *range(100, 104),
    ]
    # Up and down the same ten metres: 25 rows are 24 m of path, and 20 to 23 m of it are
    # is_validation out.
    poses = along(25)
    poses[:, 0, 3] = np.concatenate([np.arange(10), np.arange(8, 0, -1), np.arange(0, 7)])
    is_validation = blocks(poses, np.zeros(25, np.int64), 40.0, 4.0)
    assert np.flatnonzero(is_validation).tolist() == [20, 21, 22, 23]


def test_a_place_never_loses_its_last_row() -> None:
    # Rows 20 to 23 would go; 20 and 21 are all of place 1, 22 and 23 share place 2 with row 24.
    places = np.concatenate([np.zeros(20), [1, 1, 2, 2, 2], np.full(10, 3)]).astype(np.int64)
    assert np.flatnonzero(blocks(along(35), places, 40.0, 4.0)).tolist() == [22, 23]


def test_validation_submaps_are_numbered_by_their_block() -> None:
    poses = along(120)
    is_validation = blocks(poses, np.zeros(120, np.int64), 40.0, 4.0)
    assert number_blocks(poses, is_validation, 40.0, 4.0).tolist() == [0] * 4 + [1] * 4 + [2] * 4
    # A block that lost its middle, since a place would have lost its last row, stays one.
    is_validation[21:23] = False
    assert number_blocks(poses, is_validation, 40.0, 4.0).tolist() == [0] * 2 + [1] * 4 + [2] * 4
    # All is_validation out: stretches of half of 40 m, or of the 40 m that a block is long. 120
    # rows are 119 m.
    every = np.ones(120, bool)
    assert number_blocks(poses, every, 40.0, 4.0).tolist() == np.repeat(np.arange(6), 20).tolist()
    assert number_blocks(poses, every, 40.0, 40.0).tolist() == np.repeat(np.arange(3), 40).tolist()
    assert not len(number_blocks(poses, ~every, 40.0, 4.0))


@given(
    st.integers(1, 200),
    st.integers(1, 40),
    st.floats(1, 50),
    st.floats(0, 50),
    st.integers(0, 2**32),
)
@settings(max_examples=40)
def test_whatever_is_validation_every_place_is_trained(
    n: int, places: int, every_m: float, length_m: float, seed: int
) -> None:
    place = np.random.default_rng(seed).integers(0, places, n)
    is_validation = blocks(along(n), place, every_m, length_m)
    assert set(place[~is_validation]) == set(place)
