"""Tests the tiles of a 3-D map: voxel means, tiles, and coordinates of a country's grid."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.mapping import tiled_map
from pipeline.mapping.tiled_map import TILE_M, Thinning, TiledMap
from tests.mapping.town import town

UTM_M = np.array([690_000.0, 4_000_000.0, 500.0])


def tiled(*blocks_m: np.ndarray, voxel_m: float = 0.4) -> TiledMap:
    thinning = Thinning(voxel_m)
    for block_m in blocks_m:
        thinning.add(block_m)
    return thinning.tiled()


def all_points_m(tiles: TiledMap) -> np.ndarray:
    """All points (n, 3), in the order of x, y and z."""
    points_m = np.concatenate(list(tiles.tiles_m()))
    return points_m[np.lexsort(points_m.T[::-1])]


def test_a_voxel_keeps_the_mean_of_its_points() -> None:
    # Voxels of .5 m: the first two points share the one from (1, 2, 0) on, the third is in the
    # next along x, and the fourth lies below zero, from (−.5, −.5, −.5) on.
    points_m = np.array([[1.1, 2.1, 0.1], [1.3, 2.3, 0.2], [1.6, 2.1, 0.1], [-0.1, -0.2, -0.3]])
    found_m = all_points_m(tiled(points_m, voxel_m=0.5))
    expected_m = [[-0.1, -0.2, -0.3], [1.2, 2.2, 0.15], [1.6, 2.1, 0.1]]
    np.testing.assert_allclose(found_m, expected_m, atol=1e-9)


def test_the_mean_is_of_points_and_not_of_the_means_of_blocks() -> None:
    # (.1 + .1 + .1 + .3) / 4 = .15, where the mean of the means of both blocks is .2
    one, other = np.array([[0.1, 0.1, 0.1]] * 3), np.array([[0.3, 0.3, 0.3]])
    np.testing.assert_allclose(all_points_m(tiled(one, other)), [[0.15] * 3], atol=1e-9)


def test_tiles_have_sides_of_50_m_also_below_zero() -> None:
    # Tiles along x begin at −50, 0 and 50.
    tiles = tiled(np.array([[-0.9, 1.0, 0.0], [0.9, 1.0, 0.0], [49.5, 1.0, 0.0], [50.5, 1.0, 0]]))
    assert TILE_M == 50
    assert tiles.tile_corner_m[:, 0].tolist() == [-50, 0, 50]
    assert tiles.tile_corner_m[:, 1].tolist() == [0, 0, 0]
    assert tiles.offsets.tolist() == [0, 1, 3, 4]
    np.testing.assert_allclose(tiles.tile_m(1), [[0.9, 1, 0], [49.5, 1, 0]], atol=1e-9)


def test_points_around_a_position_are_those_nearer_from_above() -> None:
    map_m = town(1, 120)
    tiles = tiled(map_m)
    middle_m = np.array([55.0, 45.0])  # reaches into six tiles
    everything_m = all_points_m(tiles)
    away_m = np.linalg.norm(everything_m[:, :2] - middle_m, axis=1)
    found_m = tiles.around(middle_m, 30.0)
    found_m = found_m[np.lexsort(found_m.T[::-1])]
    np.testing.assert_array_equal(found_m, everything_m[away_m < 30])
    assert not len(tiles.around(np.array([-500.0, 0.0]), 30.0))


def test_coordinates_of_utm_lose_less_than_a_centimetre() -> None:
    rng = np.random.default_rng(2)
    # One point in each voxel of .5 m, so that each mean is a point.
    cells = np.argwhere(np.ones((20, 20, 4))) * 0.5
    points_m = cells + rng.uniform(0.05, 0.45, cells.shape) + UTM_M
    found_m = all_points_m(tiled(points_m, voxel_m=0.5))
    expected_m = points_m[np.lexsort((cells + UTM_M).T[::-1])]
    away_m = np.abs(found_m[:, None] - expected_m).max(axis=2).min(axis=1)
    assert len(found_m) == len(expected_m)
    assert away_m.max() < 0.0051  # half a grain, and 32-bit floats of less than a voxel
    low_m, high_m = tiled(points_m, voxel_m=0.5).box_m
    np.testing.assert_allclose([low_m, high_m], [points_m.min(0), points_m.max(0)], atol=0.0051)


def test_blocks_in_another_order_give_the_same_map() -> None:
    map_m = town(3, 100)
    blocks_m = np.array_split(map_m, 7)
    tiles = tiled(*blocks_m)
    turned = tiled(*blocks_m[::-1])
    np.testing.assert_array_equal(tiles.offsets, turned.offsets)
    np.testing.assert_array_equal(tiles.tile_corner_m, turned.tile_corner_m)
    # Sums of floats in another order may round to the next grain.
    assert np.abs(tiles.points.astype(int) - turned.points).max() <= 1


def test_a_column_of_tiles_may_be_joined_many_times(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks_m = np.array_split(town(3, 100), 20)
    at_once = tiled(*blocks_m)
    monkeypatch.setattr(tiled_map, "FULL", 50)
    often = tiled(*blocks_m)
    np.testing.assert_array_equal(at_once.offsets, often.offsets)
    assert np.abs(at_once.points.astype(int) - often.points).max() <= 1


def test_tiles_of_few_points_are_left_out_as_strays() -> None:
    block_m = np.argwhere(np.ones((6, 6, 1))) + 0.5
    strays_m = np.array([[500.5, 0.5, 0.5], [500.5, 3.5, 0.5]])
    tiles = tiled(strays_m, block_m)
    kept, strays = tiles.without_strays(20)
    assert (len(tiles), len(kept), strays) == (2, 1, 2)
    np.testing.assert_allclose(all_points_m(kept), block_m, atol=1e-9)
    assert kept.without_strays(20) == (kept, 0)
    nothing, strays = tiles.without_strays(100)
    assert (len(nothing), strays) == (0, 38)


def test_points_far_above_the_others_of_their_tile_are_left_out() -> None:
    # 16-bit heights reach 327 m from the middle height of a tile, 10 m.
    points_m = np.array([[1.0, 1, 10], [2, 1, 10], [3, 1, 10], [4, 1, 300], [5, 1, 400]])
    np.testing.assert_allclose(all_points_m(tiled(points_m))[:, 2], [10, 10, 10, 300], atol=1e-9)


def test_a_point_hundreds_of_kilometres_off_and_a_map_without_points_are_refused() -> None:
    thinning = Thinning(0.4)
    thinning.add(np.empty((0, 3)))
    with pytest.raises(InputError, match="a map without points"):
        thinning.tiled()
    thinning.add(np.zeros((1, 3)))
    with pytest.raises(InputError, match="a point at 0, 300000, 0 m is far from all others"):
        thinning.add(np.array([[0.0, 100, 0], [0.0, 300_000, 0]]))


def test_arrays_of_a_site_give_the_map_back_and_others_are_refused() -> None:
    tiles = tiled(town(0, 60))
    again = TiledMap.of_arrays(tiles.arrays)
    np.testing.assert_array_equal(all_points_m(again), all_points_m(tiles))
    for name, wrong in {
        "offsets": tiles.offsets[:-1],
        "points": tiles.points[:-1],
        "tile_corner_m": tiles.tile_corner_m * np.nan,
    }.items():
        with pytest.raises(ValueError, match=r"points .*, offsets"):
            TiledMap.of_arrays(tiles.arrays | {name: wrong})
