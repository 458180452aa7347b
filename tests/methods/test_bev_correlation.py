"""Tests the search for scans in the walls of training, and in those of a map."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.correlation import WallMap, drawn_map
from pipeline.matching.ranking import Rows
from pipeline.methods.bev_correlation import KIND, BevCorrelation
from pipeline.views.walls import Walls
from tests.mapping.town import scan, town
from tests.posing.scene import planar

RANGE_M = 30.0
VIEW = Walls(range_m=RANGE_M)
PATH = [planar(x_m, 60.0, 0.0) for x_m in range(20, 100, 5)]
METHOD = BevCorrelation(blocks=500)
MAP_M = town(2, 120.0)


def rows(poses: list[np.ndarray]) -> Rows:
    """The views of scans of the town at these poses, 1 s apart."""
    images = np.stack([VIEW(scan(MAP_M, pose, RANGE_M)) for pose in poses])
    return Rows(images, np.arange(len(poses)) * 10**9, np.stack(poses))


@pytest.fixture(scope="module")
def model() -> dict[str, np.ndarray]:
    """Two training views in each place."""
    return dict(METHOD.learn(rows(PATH), np.arange(len(PATH)) // 2, Progress()))


def test_turned_scans_beside_the_path_are_found(model: dict[str, np.ndarray]) -> None:
    poses = [planar(x_m, 63.0, heading) for x_m, heading in ((33, 150), (52, 222), (71, 10))]
    ranking = METHOD.localizer(model)(rows(poses), 5)
    assert ranking.places.shape == (3, 5)
    away_m = np.linalg.norm(ranking.xy_m[:, 0] - [(33, 63), (52, 63), (71, 63)], axis=1)
    assert away_m.max() < 2
    turn_deg = (ranking.heading_deg[:, 0] - (150, 222, 10) + 180) % 360 - 180
    assert np.abs(turn_deg).max() < 6
    # The nearest views are at x = 35, 50 (or 55) and 70: places (35 − 20) / 5 / 2 and so on.
    assert ranking.places[[0, 2], 0].tolist() == [1, 5]
    assert ranking.places[1, 0] in (3, 3)
    assert ranking.kinds == (KIND,)
    np.testing.assert_allclose(ranking.novelty[:, 0], ranking.costs[:, 0])
    assert (np.diff(ranking.costs, axis=1) >= 0).all()


def test_a_scan_without_walls_has_no_answer_and_is_wholly_novel(
    model: dict[str, np.ndarray],
) -> None:
    nothing = Rows(np.zeros((1, *VIEW.shape), np.int8), np.zeros(1, np.int64), np.eye(4)[None])
    ranking = METHOD.localizer(model)(nothing, 3)
    assert ranking.places.tolist() == [[-1, -1, -1]]
    assert np.isinf(ranking.costs).all()
    assert np.isnan(ranking.xy_m).all()
    assert ranking.novelty.tolist() == [[1.0]]


def test_a_scan_of_another_town_is_more_novel(model: dict[str, np.ndarray]) -> None:
    other_m = town(9, 120.0)
    poses = PATH[2:12:3]
    images = np.stack([VIEW(scan(other_m, pose, RANGE_M)) for pose in poses])
    elsewhere = Rows(images, np.zeros(len(poses), np.int64), np.stack(poses))
    localizer = METHOD.localizer(model)
    assert localizer(elsewhere, 1).novelty.min() > localizer(rows(poses), 1).novelty.max()


def test_a_view_of_another_size_is_refused(model: dict[str, np.ndarray]) -> None:
    other = Rows(np.zeros((1, 20, 20), np.int8), np.zeros(1, np.int64), np.eye(4)[None])
    with pytest.raises(InputError, match=r"\(20, 20\): expected 60 cells a side"):
        METHOD.localizer(model)(other, 1)


def test_a_map_has_the_number_of_points_in_each_cell_and_candidates_around_the_path() -> None:
    wall = np.array([[5, 5], [5, 5], [5, 5], [2, 7]])
    visited = np.array([[3, 4]])
    # The least cell is (2, 4), the largest (5, 7), with a border of 2 cells to each side.
    drawn = drawn_map(wall, visited, candidates_m=1.0, cell_m=0.5, reach_cells=30)
    assert drawn.counts.shape == (8, 8)
    np.testing.assert_array_equal(drawn.corner_m, [0.0, 1.0])
    assert drawn.counts[5, 3] == 3
    assert drawn.counts[2, 5] == 1
    assert drawn.counts.sum() == 4
    # (3, 4) is (3, 2) in the map; the candidates are up to 2 cells beside it.
    expected = np.zeros((8, 8), bool)
    expected[1:6, 0:5] = True
    np.testing.assert_array_equal(drawn.is_candidate, expected)


def test_more_points_in_a_cell_than_a_byte_counts_are_255() -> None:
    drawn = drawn_map(np.zeros((1000, 2), np.int64), np.zeros((1, 2), np.int64), 1.0, 1.0, 5)
    assert drawn.counts.max() == 255


def test_a_map_may_have_no_walls() -> None:
    drawn = drawn_map(np.empty((0, 2), np.int64), np.zeros((1, 2), np.int64), 1.0, 1.0, 5)
    assert not drawn.counts.any()


def test_a_model_keeps_the_map_as_it_is() -> None:
    drawn = drawn_map(np.array([[5, 6], [1, 2]]), np.array([[3, 3]]), 2.0, 1.0, 30)
    again = WallMap.of_arrays(drawn.arrays, 1.0)
    np.testing.assert_array_equal(again.counts, drawn.counts)
    np.testing.assert_array_equal(again.is_candidate, drawn.is_candidate)
    np.testing.assert_array_equal(again.corner_m, drawn.corner_m)
    assert again.reach_cells == 30
