"""Tests of which submaps a later day contradicts: walls that were torn down, and walls that were
built."""

import numpy as np
import pytest

from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.posing.changes import contradicted, usual_contradiction
from pipeline.posing.targets import Targets
from pipeline.posing.walls import Walls
from tests.posing.scene import planar

WALLS = Walls()
NEAR = 10.0
FAR = 20.0


def room(wall_m: float) -> np.ndarray:
    """Points (n, 3) of a wall all around, at this distance, and of a second one ahead at FAR."""
    bearing = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ring = np.column_stack([np.cos(bearing), np.sin(bearing)])
    behind = np.abs(bearing - np.pi) < np.pi / 2
    xy = np.concatenate([ring[behind] * FAR, ring[~behind] * wall_m])
    return np.column_stack([xy, np.full(len(xy), 2.0)])


def targets(*points: np.ndarray) -> Targets:
    """A map of submaps 2 m apart along x, each as seen from its own anchor."""
    grains = [np.rint(one / GRAIN_M).astype(np.int64) for one in points]
    arrays = {
        "points": np.concatenate(grains),
        "offsets": np.cumsum([0, *map(len, grains)]),
        "world_T_anchor": np.array([planar(2.0 * row, 0, 0) for row in range(len(points))]),
    }
    return Targets(arrays, GRAIN_M, 80.0, True)


def moved_room(x_m: float) -> np.ndarray:
    return room(FAR) - np.array([x_m, 0, 0])


def test_a_wall_that_is_gone_is_reported_by_two_scans_and_not_by_one() -> None:
    mapped = targets(room(NEAR))
    scans = [room(FAR), moved_room(1.0)]
    poses = np.array([planar(0, 0, 0), planar(1.0, 0, 0)])
    # the nearer of the two takes its place
    assert contradicted(mapped, WALLS, scans, poses, 0.1) == {0: 0}
    assert contradicted(mapped, WALLS, scans[:1], poses[:1], 0.1) == {}


def test_a_wall_that_was_built_is_reported_too() -> None:
    assert contradicted(
        targets(room(FAR)), WALLS, [room(NEAR)] * 2, np.array([planar(0, 0, 0)] * 2), 0.1
    ) == {0: 0}


def test_nothing_has_changed_where_scans_see_the_same_or_stand_elsewhere() -> None:
    same = np.array([planar(0, 0, 0)] * 2)
    assert contradicted(targets(room(NEAR)), WALLS, [room(NEAR)] * 2, same, 0.0) == {}
    assert (
        contradicted(
            targets(room(NEAR)), WALLS, [room(FAR)] * 2, np.array([planar(6, 0, 0)] * 2), 0.1
        )
        == {}
    )


def test_what_is_usual_is_learned_from_neighbours_in_the_map() -> None:
    assert usual_contradiction(targets(room(FAR), moved_room(2.0)), WALLS) == pytest.approx(
        0, abs=0.02
    )
    # No neighbours: nothing can be reported
    assert usual_contradiction(targets(room(NEAR)), WALLS) == 1.0
