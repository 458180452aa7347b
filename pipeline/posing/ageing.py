"""Ageing: a held-out scan as a later day would see it (METHODS 9.5).

A verdict so learns from more than the scan's own day. New walls and what they hide, a wedge in
which nothing is left, cars and crowns that came, things that went, leaves and snow: the strengths
are fixed beforehand, never by a result.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations.construction import Construction
from pipeline.core.errors import ConfigError
from pipeline.core.settings import NotNegative, Share, check
from pipeline.posing.registration import Points

AWAY_M = (5.0, 30.0)
"""Distance from the sensor to what came or went."""
WENT_M = (2.0, 5.0)
"""Radius of what went."""
CAR_M = np.array([4.5, 1.8, 1.5])
"""Length, width and height of a car."""
CAR_POINTS = 150
CROWN_M = (1.0, 2.5)
"""Radius of a crown."""
CROWN_HIGH_M = (3.0, 6.0)
"""How high its middle is."""
CROWN_POINTS = 200


@dataclass(frozen=True)
class Ageing:
    """How much changes at most; each query draws its own changes."""

    walls: int = 1
    """New walls, with what they hide: 0 to this many, each as likely."""
    wedge_deg: NotNegative = 90.0
    """Width of the directions in which nothing is left, up to this, in every other query."""
    cars: int = 10
    """Cars that came: 0 to this many."""
    crowns: int = 2
    """Crowns of trees that came: 0 to this many."""
    went: int = 3
    """Upright cylinders in which nothing is left, as of a kiosk or a hedge: 0 to this many."""
    above: Share = 0.3
    """Share of the points above `above_m` that are gone, up to this: leaves fall."""
    below: Share = 0.1
    """Share of the points below `above_m` that are gone, up to this: snow, cars, people."""
    above_m: NotNegative = 2.0
    construction: Construction = field(default_factory=lambda: Construction(spacing_m=0.4))

    def __post_init__(self) -> None:
        check(self, "ageing")
        for name in ("walls", "cars", "crowns", "went"):
            if getattr(self, name) < 0:
                raise ConfigError(
                    f"ageing.{name}={getattr(self, name)}: expected a number from 0 on"
                )

    def aged(self, points_m: Points, rng: np.random.Generator) -> Points:
        """The points (n, 3) of a scan after a year: with what has been built, without what is gone.

        z is up from the ground around the sensor.
        """
        walls = self.construction.random_walls(int(rng.integers(0, self.walls + 1)), rng)
        for wall in walls:
            points_m = np.concatenate([points_m, wall.points(self.construction.spacing_m)])
        for wall in walls:
            points_m = points_m[~wall.hides(points_m, self.construction.sensor_height_m)]
        for middle_m in _places(rng, int(rng.integers(0, self.went + 1))):
            points_m = points_m[np.hypot(*(points_m[:, :2] - middle_m).T) >= rng.uniform(*WENT_M)]
        for largest_count, make_points in ((self.cars, _car), (self.crowns, _crown)):
            for middle_m in _places(rng, int(rng.integers(0, largest_count + 1))):
                points_m = np.concatenate([points_m, make_points(rng) + np.append(middle_m, 0.0)])
        width_rad = np.deg2rad(rng.uniform(0, self.wedge_deg)) * rng.integers(0, 2)
        first_rad = rng.uniform(0, 2 * np.pi)
        bearing_rad = (np.arctan2(points_m[:, 1], points_m[:, 0]) - first_rad) % (2 * np.pi)
        points_m = points_m[bearing_rad >= width_rad]
        return points_m[rng.random(len(points_m)) >= self._gone(points_m, rng)]

    def _gone(self, points_m: Points, rng: np.random.Generator) -> NDArray[np.float64]:
        """The chance (n,) of each point to be gone."""
        above = rng.uniform(0, self.above)
        below = rng.uniform(0, self.below)
        return np.where(points_m[:, 2] > self.above_m, above, below)


def _places(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Where things stand (count, 2), at any distance of AWAY_M."""
    away_m = rng.uniform(*AWAY_M, count)
    bearing_rad = rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([away_m * np.cos(bearing_rad), away_m * np.sin(bearing_rad)])


def _car(rng: np.random.Generator) -> Points:
    """Points (n, 3) of the five faces of a parked car, at any heading."""
    points_m = rng.uniform(-0.5, 0.5, (CAR_POINTS, 3)) * CAR_M
    face = rng.integers(0, 5, CAR_POINTS)
    rows = np.arange(CAR_POINTS)
    # the last face is its roof
    points_m[rows, face // 2] = np.where(face % 2, -0.5, 0.5) * CAR_M[face // 2]
    turn = rng.uniform(0, np.pi)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.column_stack([points_m[:, :2] @ rotation, points_m[:, 2] + CAR_M[2] / 2])


def _crown(rng: np.random.Generator) -> Points:
    """Points (n, 3) of the leaves of a tree."""
    out = rng.normal(0, 1, (CROWN_POINTS, 3))
    radius_m = rng.uniform(*CROWN_M)
    middle_m = np.array([0.0, 0.0, rng.uniform(*CROWN_HIGH_M)])
    return np.asarray(radius_m * out / np.linalg.norm(out, axis=1, keepdims=True) + middle_m)
