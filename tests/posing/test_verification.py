"""Verification: a wall that the map has, one that it contradicts, and one that was hidden from it."""

import numpy as np
import pytest

from pipeline.posing.registration import Registration
from pipeline.posing.verification import structure
from pipeline.posing.walls import Walls


def wall(x_m: float, half_m: float = 10.0, n: int = 1000) -> np.ndarray:
    """Across the x axis, 1 to 6 m high."""
    rng = np.random.default_rng(int(x_m))
    return np.column_stack([np.full(n, x_m), rng.uniform(-half_m, half_m, n), rng.uniform(1.1, 6, n)])


def test_walls_speak_for_and_against_a_pose_and_hidden_ones_say_nothing() -> None:
    walls, registration = Walls(), Registration()
    map_m = wall(30.5)
    target, chart = registration.prepare(map_m), walls.chart(map_m)

    def share(*walls_m: np.ndarray) -> float:
        return structure(np.concatenate(walls_m), target, chart, walls, 0.5)

    assert share(wall(30.5)) == 1.0
    assert share(wall(30.5), wall(38.5)) == 1.0  # behind the map's wall
    assert share(wall(30.5), wall(15.5, half_m=4.0)) == pytest.approx(0.5, abs=0.01)
    assert share(wall(15.5, half_m=4.0)) == 0.0
    ground = np.column_stack([np.random.default_rng(0).uniform(-9, 9, (100, 2)), np.zeros(100)])
    assert share(ground) == 0.0
