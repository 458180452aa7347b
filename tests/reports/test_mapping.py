"""The figure of the dynamic octree: the same bytes each time, and squares where the map is occupied."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.text import Text

from pipeline.mapping.octree import Octree
from pipeline.reports.mapping import bird_view, tops
from pipeline.reports.style import SIMULATED, save
from pipeline.views.birdview import BirdView

VIEW = BirdView(Octree(edge_m=32.0, depth=6), side_px=32)


def pose(x: float, y: float, yaw: float) -> np.ndarray:
    made = np.eye(4)
    made[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    made[:2, 3] = x, y
    return made


def wall() -> np.ndarray:
    """8 m ahead, from 4 m left to 4 m right, 3 m high, and the ground before it."""
    upright = np.stack(np.meshgrid([8.2], np.arange(-3.9, 4, 0.2), np.arange(0.1, 3, 0.2)), -1).reshape(-1, 3)
    ground = np.stack(np.meshgrid(np.arange(2, 8, 0.25), np.arange(-3.9, 4, 0.25), [0.0]), -1).reshape(-1, 3)
    return np.concatenate([upright, ground])


@pytest.mark.parametrize("at", [pose(0, 0, 0), pose(40.2, -3.1, 2.0)])
@pytest.mark.parametrize(("depth", "edge_m"), [(6, 0.5), (4, 2.0)])
def test_squares_lie_where_the_wall_is_with_the_height_of_its_top(at: np.ndarray, depth: int, edge_m: float) -> None:
    grown = VIEW.octree.grow()
    grown.insert(wall(), at)
    corners_m, heights_m = tops(grown, at, VIEW, depth)
    middles_m = corners_m.mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(corners_m[:, 1] - corners_m[:, 0], axis=1), edge_m)
    assert np.abs(middles_m[:, 0] - 8.2).max() <= edge_m * 0.71
    assert np.abs(middles_m[:, 1]).max() < 4 + edge_m * 0.71
    assert np.ptp(middles_m[:, 1]) > 8 - 2 * edge_m
    np.testing.assert_allclose(heights_m, 2.75)  # the highest leaf is from 2.5 m to 3 m


def test_the_figure_is_the_same_file_each_time_and_honest_about_simulation(tmp_path: Path) -> None:
    at, digests = pose(3.0, 1.0, 0.3), set()
    for number in range(2):
        grown = VIEW.octree.grow()
        grown.insert(wall(), at)
        fig = bird_view(wall(), grown, at, VIEW, simulated=True)
        assert SIMULATED in [text.get_text() for text in fig.findobj(Text)]
        squares = [len(found.get_paths()) for found in fig.findobj(PolyCollection)]
        assert squares == [len(tops(grown, at, VIEW, depth)[1]) for depth in (6, 4)]
        digests.add(save(fig, tmp_path / f"{number}.png").read_bytes())
    assert len(digests) == 1
    assert SIMULATED not in [text.get_text() for text in bird_view(wall(), grown, at, VIEW, simulated=False).findobj(Text)]
