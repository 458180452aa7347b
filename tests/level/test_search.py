"""Branch and bound finds the poses that an exhaustive search finds."""

import numpy as np
import pytest

from pipeline.level.field import Field
from pipeline.level.level_map import LevelMap
from pipeline.level.search import APART_DEG, APART_M, HEADINGS, search
from tests.level import hall
from tests.level.hall import sweep


@pytest.fixture(scope="module")
def field() -> Field:
    return hall.field()


def exhaustive(field: Field, points_m: np.ndarray) -> float:
    """The best score of all cells and headings, by trying each."""
    likelihood = field.pyramid.levels[0].astype(int)
    rows, cols = np.nonzero(field.can_stand)
    best = 0.0
    for heading in 2 * np.pi / HEADINGS * np.arange(HEADINGS):
        cos, sin = np.cos(heading), np.sin(heading)
        up = np.floor((sin * points_m[:, 0] + cos * points_m[:, 1]) / field.cell_m + 0.5)
        along = np.floor((cos * points_m[:, 0] - sin * points_m[:, 1]) / field.cell_m + 0.5)
        totals = np.zeros(len(rows), int)
        for u, a in zip(up.astype(int), along.astype(int), strict=True):
            totals += likelihood[rows + field.pyramid.margin + u, cols + field.pyramid.margin + a]
        best = max(best, float(totals.max()) / (255 * len(points_m)))
    return best


@pytest.mark.parametrize("place", [(4.0, 3.0, 0.3), (16.0, 6.0, 2.0), (12.0, 9.5, -2.5)])
def test_the_best_pose_is_the_best_of_all_cells_and_headings(
    field: Field, place: tuple[float, float, float]
) -> None:
    points_m = sweep(*place, beams=16)
    best = search(field, points_m, keep=2)
    score = exhaustive(field, points_m)
    assert best.exact
    assert best.scores[0] == pytest.approx(score)  # it may be another pose of the same score
    world = field.world_T_grid[:2, 3] + best.poses[0, :2]
    assert np.linalg.norm(world - place[:2]) < 0.3


def test_the_best_poses_come_first_and_all_are_distinct(field: Field) -> None:
    best = search(field, sweep(16.0, 6.0, 2.0), keep=6, min_ratio=0.3)
    assert (np.diff(best.scores) <= 0).all()
    assert len(best.poses) > 2
    for number, pose in enumerate(best.poses):
        for other in best.poses[:number]:
            turn_deg = abs((np.rad2deg(pose[2] - other[2]) + 180) % 360 - 180)
            assert np.linalg.norm(pose[:2] - other[:2]) >= APART_M - 1e-9 or turn_deg >= APART_DEG


def test_in_a_symmetric_room_two_poses_are_found() -> None:
    # a bare room of 8 by 4 m, seen all around from its middle line, looks the same turned by 180°
    cells = np.zeros((82, 162), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    room = Field.of(LevelMap(cells, 0.05, (0.0, 0.0, 0.0)))
    around = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    edge_m = np.minimum(
        4 / np.maximum(np.abs(np.cos(around)), 1e-9), 2 / np.maximum(np.abs(np.sin(around)), 1e-9)
    )
    points_m = edge_m[:, None] * np.column_stack([np.cos(around), np.sin(around)])
    best = search(room, points_m, keep=3, min_ratio=0.9)
    turns = np.rad2deg(best.poses[:2, 2])
    assert abs(abs(turns[0] - turns[1]) - 180) < 2
    assert best.scores[1] > 0.97 * best.scores[0]


def test_the_search_tells_if_it_ended_at_its_largest_number_of_nodes(field: Field) -> None:
    assert not search(field, sweep(4.0, 3.0, 0.3), keep=8, most_nodes=4).exact
    assert len(search(field, np.empty((0, 2))).poses) == 0
    assert len(search(field, np.full((50, 2), 500.0)).poses) == 0
