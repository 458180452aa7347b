"""Tests of the agreement of a query with a submap: walls that both have, that one contradicts, or
that were hidden."""

import numpy as np
import pytest

from pipeline.posing.registration import Registration
from pipeline.posing.verification import Agreement, Seen, agreement
from pipeline.posing.walls import Walls
from tests.posing.scene import planar

WALLS = Walls()
REGISTRATION = Registration()


def wall(x_m: float, half_m: float = 10.0, n: int = 3000) -> np.ndarray:
    """Across the x axis, 1 to 6 m high."""
    rng = np.random.default_rng(int(x_m))
    return np.column_stack(
        [np.full(n, x_m), rng.uniform(-half_m, half_m, n), rng.uniform(1.1, 6, n)]
    )


def seen(*walls_m: np.ndarray) -> Seen:
    return seen_by(np.concatenate(walls_m))


def seen_by(points_m: np.ndarray, single: bool = True) -> Seen:
    cloud = REGISTRATION.prepare(points_m)
    chart = WALLS.chart(WALLS.of(points_m), single)
    return Seen.of(WALLS, cloud, chart)


def result(query: Seen, ahead_m: float = 0.0) -> Agreement:
    """With a map of one wall 30.5 m ahead, from so far ahead."""
    return agreement(WALLS, 0.5, seen(wall(30.5)), query, planar(ahead_m, 0, 0))


def test_walls_are_evidence_for_or_against_a_pose_and_hidden_walls_are_none() -> None:
    assert result(seen(wall(30.5))) == Agreement(1.0, 1.0, 1.0)
    behind = result(seen(wall(30.5), wall(38.5)))
    assert behind.structure == 1.0
    # of the query's walls the map has half, hidden or not; of the map's the query has all
    assert behind.overlap == pytest.approx(0.75, abs=0.03)
    across = result(seen(wall(30.5), wall(15.5, half_m=4.0)))
    assert across.structure == pytest.approx(20 / (20 + 8), abs=0.05)
    assert result(seen(wall(15.5, half_m=4.0))).structure == 0.0


def test_the_maps_walls_are_seen_again_or_seen_through_or_hidden() -> None:
    assert result(seen(wall(20.5)), ahead_m=10.0) == Agreement(1.0, 1.0, 1.0)
    # The query looks through where the map has its wall
    assert result(seen(wall(38.5))).seen_again == 0.0
    half = result(seen(wall(30.5)[wall(30.5)[:, 1] > 0], wall(38.5)[wall(38.5)[:, 1] < 0]))
    assert half.seen_again == pytest.approx(0.5, abs=0.05)
    # The wall is hidden: there is no evidence for the pose
    assert result(seen(wall(15.5, half_m=9.0))).seen_again == 0.0


def test_a_high_wall_counts_no_more_than_a_low_one() -> None:
    """Of the map's two walls of 20 m the query has the high one, of nine tenths of the voxels."""
    low = wall(30.5) * (1.0, 1.0, 0.0) + (-10.0, 0.0, 1.2)
    both = seen(wall(30.5), low)
    agreed = agreement(WALLS, 0.5, both, seen(wall(30.5)), planar(0, 0, 0))
    assert agreed.overlap == pytest.approx((1.0 + 0.5) / 2, abs=0.03)


def test_a_query_of_several_scans_contradicts_nothing() -> None:
    assert result(seen_by(wall(38.5), single=False)) == Agreement(0.0, 0.0, 0.0)
