"""The bricks of the dynamic octree: their memory follows what is known.

That they hold the bits of a dense map is reported by the bytes of bird-views (tests/views).
"""

import math
from typing import Any

import numpy as np
import pytest

from pipeline.core import frames
from pipeline.core.errors import InputError
from pipeline.mapping.bricks import BRICK, LEAVES, NO_BRICK, Bricks
from pipeline.mapping.octree import Octree

NEAR = {"edge_m": 16.0, "depth": 5, "sensor_height_m": 1.0}
"""Settings of a map with leaves of 0.5 m, 32 along an edge: four bricks of 4 m."""


def at(x: float, y: float = 0.0, z: float = 0.0, *turned: float) -> np.ndarray:
    """One pose (4, 4), from metres, and roll, pitch and yaw in radians."""
    return frames.pose(np.array([[x, y, z]]), np.array([turned or (0.0, 0.0, 0.0)]))[0]


def assert_sound(bricks: Bricks) -> None:
    """Table and places agree, and nothing is left where no brick is in use."""
    used = int(bricks.used[0])
    assert len(np.unique(bricks.places[:used])) == used
    np.testing.assert_array_equal(bricks.table[bricks.places[:used]], np.arange(used) * LEAVES)
    assert (bricks.table != NO_BRICK).sum() == used
    assert not bricks.marks.any()
    assert not bricks.log_odds[used * LEAVES :].any()
    assert bricks.log_odds[: used * LEAVES].reshape(used, LEAVES).any(axis=1).all()


def test_leaves_outside_the_cube_are_dropped_though_their_brick_stays() -> None:
    made = Octree(**NEAR, motion="none").grow()
    # the two lowest leaves along x
    made.insert(np.array([[-7.9, 0.2, 1.2], [-7.4, 0.2, 1.2]]), at(0.1))
    place = made.bricks.places[: made.bricks.used[0]].tolist()
    assert np.argwhere(made.log_odds > 0)[:, 0].tolist() == [0, 1]
    made.insert(np.empty((0, 3)), at(0.6))  # a leaf on
    assert np.argwhere(made.log_odds > 0)[:, 0].tolist() == [0]
    assert made.bricks.places[: made.bricks.used[0]].tolist() == place
    made.insert(np.empty((0, 3)), at(0.1))
    assert np.argwhere(made.log_odds > 0)[:, 0].tolist() == [1]


def test_bricks_are_allocated_along_rays_alone() -> None:
    made = Octree(**NEAR, motion="none").grow()
    assert made.bricks.used[0] == 0
    made.insert(np.array([[7.2, 0.2, 1.2]]), at(0.1))  # along x from 0.1 m to 7.3 m: bricks of 4 m
    assert made.bricks.used[0] == 2
    # no further than the window
    made.insert(np.array([[20.0, 0.2, 1.2], [0.2, 0.2, 0.9]]), at(0.1))
    assert made.bricks.used[0] == 2


def test_points_beyond_the_reach_touch_no_brick() -> None:
    made = Octree(**NEAR, max_range_m=3.0).grow()
    made.insert(np.array([[7.2, 0.2, 1.2], [7.2, 0.3, 1.2]]), at(0.1))
    assert made.bricks.used[0] == 1
    assert not (made.log_odds > 0).any()


def test_bricks_that_fade_or_leave_are_used_again() -> None:
    made = Octree(**NEAR).grow()
    points = np.random.default_rng(2).normal(0, 4, (200, 3))
    made.insert(points, at(0.0))
    before = made.bricks.nbytes
    for away in (
        at(0.0, 0.0, 0.0, 0.0, 0.0, 3.0),
        at(100.0),
    ):  # exp(−18) of all is left; nothing is
        made.insert(np.empty((0, 3)), away)
        assert made.bricks.used[0] == 0
        assert_sound(made.bricks)
        made.insert(points, away)
        assert 8 < made.bricks.used[0] <= 64
        assert made.bricks.nbytes <= 1.1 * before


def test_memory_follows_what_is_known() -> None:
    made = Octree(edge_m=64.0, depth=7).grow()
    rng = np.random.default_rng(3)
    ring = np.stack(
        [
            np.cos(angle := rng.uniform(-math.pi, math.pi, 2000)),
            np.sin(angle),
            rng.uniform(-0.1, 0.1, 2000),
        ],
        axis=1,
    )
    sizes = []
    for scan in range(120):
        made.insert(ring * rng.uniform(5, 12), at(-300.0 + 5 * scan, 2.0 * scan))
        sizes.append(made.bricks.nbytes)
        assert_sound(made.bricks)
    assert max(sizes[60:]) <= 1.2 * max(sizes[:60])
    assert max(sizes) < 0.1 * made.log_odds.nbytes
    wide = np.concatenate([ring * r for r in range(5, 32)])
    made.insert(wide, at(300.0))
    assert made.bricks.nbytes > 2 * max(sizes)
    for scan in range(3):
        made.insert(ring * 5, at(1000.0 + 100 * scan))
    assert made.bricks.nbytes <= max(sizes)


def test_scans_that_outgrow_the_pools_lose_no_ray() -> None:
    # One scan that needs many bricks, against the same points one after another at rest: the same
    # leaves are known.
    octree = Octree(edge_m=64.0, depth=7, motion="none")
    points = np.random.default_rng(4).normal(0, 12, (1500, 3))
    whole = octree.grow()
    parts = octree.grow()
    whole.insert(points, at(0.0))
    for part in np.array_split(points, 50):
        parts.insert(part, at(0.0))
    np.testing.assert_array_equal(whole.log_odds != 0, parts.log_odds != 0)
    assert whole.bricks.used[0] > 4 * BRICK**2


def test_a_scan_that_fails_half_way_leaves_no_marks(monkeypatch: pytest.MonkeyPatch) -> None:
    made, other = (Octree(**NEAR).grow() for _ in range(2))
    points = np.random.default_rng(5).normal(0, 4, (50, 3))
    wrong = np.concatenate([points * 2, [[np.nan, 0, 0]]])
    for each in (made, other):
        each.insert(points, at(0.0))
    with pytest.raises(InputError, match="NaN"):
        made.insert(wrong, at(3.0))

    def full(bricks: Bricks, more: int) -> Any:
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr("pipeline.mapping.octree.with_room", full)
        with pytest.raises(MemoryError):
            made.insert(points, at(3.0))
    np.testing.assert_array_equal(made.log_odds, other.log_odds)
    for each in (made, other):
        each.insert(points, at(1.0))
    np.testing.assert_array_equal(made.log_odds, other.log_odds)
    assert_sound(made.bricks)
