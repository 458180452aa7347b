"""Tests of clouds as methods see them: perturbed and unperturbed, and an octree's columns."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipeline.mapping.octree import Octree
from pipeline.perturbations.construction import Construction
from pipeline.report.figures.views import bird_view as draw_bird_view
from pipeline.report.figures.views import perturbed, tops
from pipeline.views.birdview import BirdView
from pipeline.views.scan_context import ScanContext

VIEW = ScanContext(rings=8, sectors=12, max_range_m=24.0, voxel_m=0.0, min_points=1)
GROUND_M = np.column_stack(
    [*np.random.default_rng(0).uniform(-24, 24, (2, 500)), np.full(500, 0.01)]
)
WALLS = Construction(walls=(2,), shadows=(False,))

BIRD_VIEW = BirdView(Octree(edge_m=32.0, depth=6), side_px=32)


def pose(x: float, y: float, yaw: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix


def wall() -> np.ndarray:
    """Points (n, 3) of a wall 8 m ahead, 8 m wide and 3 m high, and of the ground before it."""
    upright = np.stack(
        np.meshgrid([8.2], np.arange(-3.9, 4, 0.2), np.arange(0.1, 3, 0.2)), -1
    ).reshape(-1, 3)
    ground = np.stack(
        np.meshgrid(np.arange(2, 8, 0.25), np.arange(-3.9, 4, 0.25), [0.0]), -1
    ).reshape(-1, 3)
    return np.concatenate([upright, ground])


def bird_view() -> Figure:
    octree_map = BIRD_VIEW.octree.grow()
    octree_map.insert(wall(), pose(3.0, 1.0, 0.3))
    return draw_bird_view(wall(), octree_map, pose(3.0, 1.0, 0.3), BIRD_VIEW)


def test_a_perturbed_cloud_stands_below_the_one_unperturbed() -> None:
    clouds_m = perturbed(GROUND_M, WALLS, stamp_ns=7)
    assert list(clouds_m) == ["unperturbed", "construction 2 walls"]
    driven, built = clouds_m.values()
    assert driven is GROUND_M
    assert built[:, 2].max() > 3 - 0.2 > driven[:, 2].max()  # a wall has 3 m at least
    assert perturbed(GROUND_M, WALLS, 7)["construction 2 walls"].tobytes() == built.tobytes()


@pytest.mark.parametrize("place", [pose(0, 0, 0), pose(40.2, -3.1, 2.0)])
@pytest.mark.parametrize(("depth", "edge_m"), [(6, 0.5), (4, 2.0)])
def test_squares_lie_where_the_wall_is_with_the_height_of_its_top(
    place: np.ndarray, depth: int, edge_m: float
) -> None:
    octree_map = BIRD_VIEW.octree.grow()
    octree_map.insert(wall(), place)
    corners_m, heights_m = tops(octree_map, place, BIRD_VIEW, depth)
    middles_m = corners_m.mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(corners_m[:, 1] - corners_m[:, 0], axis=1), edge_m)
    assert np.abs(middles_m[:, 0] - 8.2).max() <= edge_m * 0.71
    assert np.abs(middles_m[:, 1]).max() < 4 + edge_m * 0.71
    assert np.ptp(middles_m[:, 1]) > 8 - 2 * edge_m
    np.testing.assert_allclose(heights_m, 2.75)  # the highest leaf is from 2.5 m to 3 m
