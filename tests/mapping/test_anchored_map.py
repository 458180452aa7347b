"""Anchors on a map: where they are, and what is in the square of each."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.mapping.anchored_map import NEAR_M, SPACING_M, AnchoredMap
from pipeline.mapping.tiled_map import Thinning
from tests.mapping.made_map import sloped
from tests.readers.damage import one_line

SIDE_M = 160.0
"""Side of the town."""


def anchored(points_m: NDArray[np.float64]) -> AnchoredMap:
    thinning = Thinning(0.4)
    thinning.add(points_m)
    return AnchoredMap.of(thinning.tiled(), "town", None, Progress())


@pytest.fixture(scope="module")
def town() -> AnchoredMap:
    return anchored(sloped())


def test_anchors_are_the_middles_of_whole_squares_near_the_map(town: AnchoredMap) -> None:
    xy_m = town.world_T_anchor[:, :2, 3]
    assert np.array_equal(xy_m % SPACING_M, np.full(xy_m.shape, SPACING_M / 2))
    assert xy_m.min() >= -NEAR_M
    assert xy_m.max() <= SIDE_M + NEAR_M
    inside = ((xy_m > 0) & (xy_m < SIDE_M)).all(axis=1)
    assert inside.sum() == (SIDE_M / SPACING_M) ** 2


def test_anchors_stand_on_the_slope(town: AnchoredMap) -> None:
    """The ground rises by .1 along x: the normal is (−.1, 0, 1) / √1.01."""
    inside = ((town.world_T_anchor[:, :2, 3] % SIDE_M) == town.world_T_anchor[:, :2, 3]).all(axis=1)
    poses = town.world_T_anchor[inside]
    assert np.abs(poses[:, 2, 3] - 0.1 * poses[:, 0, 3]).max() < 0.2
    assert np.abs(poses[:, :3, 2] - np.array([-0.1, 0, 1]) / 1.01**0.5).max() < 0.05


def test_each_point_of_the_map_is_in_one_square(town: AnchoredMap) -> None:
    squares = [
        transformed(pose, town.square_m(row)) for row, pose in enumerate(town.world_T_anchor)
    ]
    cut = np.concatenate(squares)
    whole = np.concatenate(list(town.tiled.tiles_m()))
    assert np.allclose(cut[np.lexsort(cut.round(3).T)], whole[np.lexsort(whole.round(3).T)])


def test_points_of_a_square_are_in_its_anchors_frame(town: AnchoredMap) -> None:
    for row in range(0, len(town.world_T_anchor), 50):
        assert np.abs(town.square_m(row)[:, :2]).max(initial=0) < SPACING_M / 2 + 1


@pytest.mark.parametrize(
    ("points_m", "complaint"),
    [
        (np.tile([5.0, 5.0, 1.0], (5, 1)), "town: its points are strays"),
        (np.random.default_rng(0).uniform(0, 9, (500, 3)), "its points lie within 9 × 9 m"),
    ],
)
def test_what_is_no_map_of_a_place_is_refused(
    points_m: NDArray[np.float64], complaint: str
) -> None:
    with one_line(InputError, complaint):
        anchored(points_m)
