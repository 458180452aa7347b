"""The cloud view (METHODS 3.2): the ground is removed, walls stay, and clouds are reproducible."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.readers.kitti import read_velodyne
from pipeline.views.cloud import Cloud

VIEW = Cloud(points=2000, voxel_m=0.0)


def tilted(points: np.ndarray, degrees: float) -> np.ndarray:
    """Points (n, 3) rolled about x."""
    c = np.cos(np.deg2rad(degrees))
    s = np.sin(np.deg2rad(degrees))
    return points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def scene(ground: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Points (ground, 3) of a rough ground at height 0, and points (n, 3) of what stands on it.

    That is a wall 10 m to the left, from 1 to 6 m high, and a pole.
    """
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-20, 20, (ground, 2)), rng.normal(0, 0.03, ground)])
    wall = np.column_stack(
        [rng.uniform(-15, 15, 1500), np.full(1500, 10.0), rng.uniform(1, 6, 1500)]
    )
    pole = np.column_stack([np.full((300, 2), -8.0), rng.uniform(1, 9, 300)])
    return floor, np.concatenate([wall, pole])


def metres(cloud: np.ndarray, like: np.ndarray) -> np.ndarray:
    """A cloud in metres, moved back to the mean of the points `like` that it was made of."""
    return cloud.astype(np.float64) * VIEW.half_m + like.mean(axis=0)


@pytest.mark.parametrize("degrees", [0.0, 8.0, -15.0])
def test_the_ground_goes_and_what_stands_on_it_stays(degrees: float) -> None:
    floor, standing = scene()
    rng = np.random.default_rng(1)
    cloud = replace(VIEW, points=1800)(
        tilted(rng.permutation(np.concatenate([floor, standing])), degrees)
    )
    # The 1,800 points of wall and pole are all that is left, so they come once each, about their
    # own mean; float16 keeps 2⁻¹¹ of at most 25 m: half of 2.4 cm.
    left = metres(cloud, tilted(standing, degrees))
    expected = tilted(standing, degrees)
    order = np.lexsort(left.round(1).T)
    wanted = np.lexsort(expected.round(1).T)
    assert len(order) == len(wanted)
    np.testing.assert_allclose(np.sort(left, axis=0), np.sort(expected, axis=0), atol=0.013)


def test_a_wall_is_no_ground_however_many_points_it_has() -> None:
    floor, standing = scene(ground=1000)
    cloud = replace(VIEW, points=1800)(np.concatenate([floor, standing]))
    # 1,500 points of the wall against 1,000 of the ground; the wall is still there, level 10 m to
    # the left of the pole's −8.
    assert np.isclose(np.ptp(cloud[:, 1].astype(float)) * 25, 18, atol=0.03)
    steep = replace(VIEW, points=2800, slope_deg=90.0)(np.concatenate([floor, standing]))
    # With any slope allowed, the wall is what is removed.
    assert np.unique(steep, axis=0).shape[0] < 1500


def test_without_a_ground_nearly_all_points_stay() -> None:
    _, standing = scene()
    # A level slab of 2 · 0.2 m of the wall, 5 m high, and of the pole, 8 m high: about 120 + 15 of
    # the 1,800 points.
    assert len(np.unique(replace(VIEW, points=1800)(standing), axis=0)) > 1600
    floor, _ = scene(500)
    assert np.ptp(replace(VIEW, plane_m=0.0)(floor)[:, :2].astype(float)) > 1.5


def test_points_outside_the_cube_are_left_out_and_coordinates_end_at_one() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-60, 60, (20_000, 3))
    # The mean lies near x = 12.5 m: points below −12.5 m would be beyond −1.
    points[:, 0] = np.abs(points[:, 0])
    inside = points[(np.abs(points) <= 25).all(axis=1)]
    cloud = replace(VIEW, points=len(inside), plane_m=0.0)(points)
    expected = ((inside - inside.mean(axis=0)) / 25).clip(-1, 1)
    np.testing.assert_allclose(np.sort(cloud, axis=0), np.sort(expected, axis=0), atol=1e-3)
    assert np.abs(cloud).max() <= 1


def test_points_are_drawn_once_each_and_again_only_where_too_few_are_left() -> None:
    points = np.random.default_rng(3).uniform(-20, 20, (1000, 3))
    raw = replace(VIEW, plane_m=0.0)
    assert len(np.unique(replace(raw, points=600)(points), axis=0)) == 600
    again = replace(raw, points=2500)(points)
    assert len(np.unique(again, axis=0)) == len(np.unique(again[:1000], axis=0)) == 1000


def test_the_first_points_are_a_sample_too() -> None:
    points = np.column_stack(
        [np.linspace(-20, 20, 4000), np.zeros(4000), np.random.default_rng(0).uniform(0, 9, 4000)]
    )
    few = replace(VIEW, points=3000, plane_m=0.0)(points)[:300]
    # Sorted along x they would lie at one end.
    assert abs(float(few[:, 0].astype(float).mean())) < 0.1


def test_points_are_averaged_in_voxels_first() -> None:
    twice = np.repeat(np.random.default_rng(4).uniform(-20, 20, (50, 3)), 40, axis=0)
    cloud = Cloud(points=50, voxel_m=0.1, plane_m=0.0)(twice)
    # Of the 2,000 points some would come twice, and some not at all.
    assert len(np.unique(cloud, axis=0)) == 50


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_few_points_make_a_cloud_and_none_make_zeros(n: int) -> None:
    cloud = Cloud(points=16)(np.arange(3.0 * n).reshape(n, 3))
    assert cloud.shape == (16, 3)
    assert cloud.dtype == np.float16
    assert np.isfinite(cloud).all()
    assert n > 1 or not cloud.any()
    assert not Cloud(points=16)(np.full((9, 3), 40.0)).any()


def test_a_cloud_does_not_depend_on_those_before_it_nor_on_threads() -> None:
    clouds = [np.concatenate(scene(2000 + 10 * i)) for i in range(8)]
    alone = [VIEW(cloud) for cloud in clouds]
    np.random.seed(5)  # the state that it must not use
    with ThreadPoolExecutor(8) as pool:
        np.testing.assert_array_equal(list(pool.map(VIEW, clouds)), alone)
    assert not np.array_equal(replace(VIEW, seed=1)(clouds[0]), alone[0])


@pytest.mark.parametrize("spoilt", [np.nan, np.inf])
def test_points_that_are_not_finite_or_of_another_shape_are_refused(spoilt: float) -> None:
    with pytest.raises(InputError):
        VIEW(np.array([[0, 0, spoilt]]))
    with pytest.raises(InputError):
        VIEW(np.zeros((5, 2)))


def test_a_real_scan_loses_its_road_and_keeps_its_walls(real: Path) -> None:
    points = read_velodyne(real / "kitti/pairs/08/000720.bin")[:, :3] + np.array([0, 0, 1.73])
    inside = points[(np.abs(points) <= 25).all(axis=1)]
    cloud = (
        np.unique(Cloud(points=len(inside), voxel_m=0.0)(points), axis=0)[:, 2].astype(np.float64)
        * 25
    )
    height = cloud - cloud.max() + inside[:, 2].max()  # what is highest stays
    road = np.abs(inside[:, 2]) < 0.1
    above = inside[:, 2] > 1
    assert road.mean() > 0.4
    assert (np.abs(height) < 0.1).sum() < 0.1 * road.sum()
    assert (height > 1).sum() > 0.97 * above.sum()
