"""A scene for the tests of posing: points that a sensor would see of a ground and a few houses."""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.posing.aliases import Aliases
from pipeline.posing.fix import Hypothesis
from pipeline.posing.probabilities import HypothesisModel
from pipeline.posing.registration import Alignment
from pipeline.posing.verification import Agreement

OVERLAPS = HypothesisModel((10.0, *5 * (0.0,)), -5.0)
"""A model of overlap alone: a hypothesis of overlap .5 is as likely as that none is right."""


def scene(seed: int = 0, houses: int = 12) -> NDArray[np.float64]:
    """Points (n, 3) of a square of 80 m around the origin: its ground at z = 0, and some houses."""
    rng = np.random.default_rng(seed)
    parts = [np.column_stack([rng.uniform(-40, 40, (4000, 2)), rng.normal(0, 0.02, 4000)])]
    for _ in range(houses):
        away_m = rng.uniform(8, 36)
        bearing = rng.uniform(0, 2 * np.pi)
        size_m = rng.uniform(4, 14, 2)
        turn = rng.uniform(0, np.pi)
        height_m = rng.uniform(3, 9)
        along = rng.uniform(-0.5, 0.5, 900)
        side = rng.integers(4, size=900)
        half = np.where(side % 2, 0.5, -0.5)
        long_walls = np.column_stack([along, half])
        short_walls = np.column_stack([half, along])
        xy_m = np.where((side < 2)[:, None], long_walls, short_walls) * size_m
        turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        centre_m = away_m * np.array([np.cos(bearing), np.sin(bearing)])
        parts.append(np.column_stack([xy_m @ turned + centre_m, rng.uniform(0, height_m, 900)]))
    return np.concatenate(parts)


def planar(x_m: float, y_m: float, yaw_deg: float) -> NDArray[np.float64]:
    """A pose (4, 4) in the plane."""
    return pose(np.array([[x_m, y_m, 0.0]]), np.array([[0.0, 0.0, np.deg2rad(yaw_deg)]]))[0]


def seen_from(
    points_m: NDArray[np.float64], world_T_robot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points (n, 3) of the world, moved into a robot's frame."""
    robot_T_world = np.linalg.inv(world_T_robot)
    return points_m @ robot_T_world[:3, :3].T + robot_T_world[:3, 3]


def hypothesis(
    x_m: float, overlap: float, spread_m: float = 0.01, yaw_deg: float = 0.0, margin: float = 0.2
) -> Hypothesis:
    """A hypothesis at (x, 0) with this overlap and spread, whose walls agree fully with the
    map's."""
    alignment = Alignment(np.eye(4), overlap, spread_m**2 * np.eye(6), spread_m**2 * np.eye(6))
    agreement = Agreement(overlap, 1.0, 1.0)
    return Hypothesis(
        0, planar(x_m, 0, yaw_deg), alignment, agreement, agreement, 0.0, Aliases(margin, ())
    )
