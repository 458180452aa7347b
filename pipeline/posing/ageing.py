"""Simulated ageing: changes a scan's points to what a later day might see (METHODS 9.5).

In: a validation scan of the training day. Out: the scan with new walls, without the points behind
them, with new cars and tree crowns, without some objects, without a wedge of directions, and
thinned as by fallen leaves and snow. It is an augmentation: a verdict learns from aged scans too,
so that it is not fitted to one day alone. The strengths of the changes were chosen beforehand, not
by any result.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import NotNegative, Share, checked
from pipeline.perturbations.construction import Construction
from pipeline.posing.registration import Points

AWAY_M = (5.0, 30.0)
"""Distances from the sensor at which objects appear or disappear."""
WENT_M = (2.0, 5.0)
"""Radii of the cylinders whose points disappear."""
CAR_M = np.array([4.5, 1.8, 1.5])
"""Length, width and height of a car."""
CAR_POINTS = 150
CROWN_M = (1.0, 2.5)
"""Radii of the crowns of trees."""
CROWN_HIGH_M = (3.0, 6.0)
"""Heights of the centres of crowns."""
CROWN_POINTS = 200


@dataclass(frozen=True)
@checked("ageing")
class Ageing:
    """The largest changes; each scan draws its own, uniformly from 0 to these."""

    walls: int = 1
    """New walls; the points behind them are removed."""
    wedge_deg: NotNegative = 90.0
    """Width of a wedge of directions without points; about half of the scans have such a wedge."""
    cars: int = 10
    """New parked cars."""
    crowns: int = 2
    """New crowns of trees."""
    went: int = 3
    """Removed objects, such as a kiosk or a hedge: upright cylinders without points."""
    above: Share = 0.3
    """Share of the points above `above_m` that are removed, as when leaves fall."""
    below: Share = 0.1
    """Share of the points below `above_m` that are removed: snow, cars and people."""
    above_m: NotNegative = 2.0
    """Height that divides the points for `above` and `below`."""
    construction: Construction = field(default_factory=lambda: Construction(spacing_m=0.4))
    """Draws the new walls."""

    def __post_init__(self) -> None:
        for name in ("walls", "cars", "crowns", "went"):
            if getattr(self, name) < 0:
                raise ConfigError(
                    f"ageing.{name}={getattr(self, name)}: expected a number from 0 on"
                )

    def aged(self, points_m: Points, rng: np.random.Generator) -> Points:
        """The points (n, 3) of a scan as a later day might see them.

        The points are in metres in the sensor's frame, z up from the ground around the sensor.
        """
        # New walls, without the points behind them.
        walls = self.construction.random_walls(int(rng.integers(0, self.walls + 1)), rng)
        for wall in walls:
            points_m = np.concatenate([points_m, wall.points(self.construction.spacing_m)])
        for wall in walls:
            points_m = points_m[~wall.hides(points_m, self.construction.sensor_height_m)]
        # Removed objects.
        for middle_m in _positions(rng, int(rng.integers(0, self.went + 1))):
            away_m = np.hypot(*(points_m[:, :2] - middle_m).T)
            points_m = points_m[away_m >= rng.uniform(*WENT_M)]
        # New cars and crowns.
        for largest_count, make_points in ((self.cars, _car), (self.crowns, _crown)):
            for middle_m in _positions(rng, int(rng.integers(0, largest_count + 1))):
                points_m = np.concatenate([points_m, make_points(rng) + np.append(middle_m, 0.0)])
        # A wedge of directions without points.
        width_rad = np.deg2rad(rng.uniform(0, self.wedge_deg)) * rng.integers(0, 2)
        first_rad = rng.uniform(0, 2 * np.pi)
        bearing_rad = (np.arctan2(points_m[:, 1], points_m[:, 0]) - first_rad) % (2 * np.pi)
        points_m = points_m[bearing_rad >= width_rad]
        # Fallen leaves and snow.
        return points_m[rng.random(len(points_m)) >= self._removal_probability(points_m, rng)]

    def _removal_probability(
        self, points_m: Points, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """The probability (n,) that each point is removed, by its height."""
        above = rng.uniform(0, self.above)
        below = rng.uniform(0, self.below)
        return np.where(points_m[:, 2] > self.above_m, above, below)


def _positions(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Random positions (count, 2) around the sensor, at distances of AWAY_M."""
    away_m = rng.uniform(*AWAY_M, count)
    bearing_rad = rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([away_m * np.cos(bearing_rad), away_m * np.sin(bearing_rad)])


def _car(rng: np.random.Generator) -> Points:
    """Points (n, 3) on the four sides and the roof of a parked car, at a random heading."""
    points_m = rng.uniform(-0.5, 0.5, (CAR_POINTS, 3)) * CAR_M
    face = rng.integers(0, 5, CAR_POINTS)
    rows = np.arange(CAR_POINTS)
    # Faces 0 to 4 are front, back, left, right and roof; each pair lies across one axis.
    points_m[rows, face // 2] = np.where(face % 2, -0.5, 0.5) * CAR_M[face // 2]
    turn = rng.uniform(0, np.pi)
    # The transpose of a rotation, since the points are rows.
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.column_stack([points_m[:, :2] @ rotation, points_m[:, 2] + CAR_M[2] / 2])


def _crown(rng: np.random.Generator) -> Points:
    """Points (n, 3) of the crown of a tree: a sphere above the ground."""
    directions = rng.normal(0, 1, (CROWN_POINTS, 3))
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    radius_m = rng.uniform(*CROWN_M)
    middle_m = np.array([0.0, 0.0, rng.uniform(*CROWN_HIGH_M)])
    return np.asarray(radius_m * directions / lengths + middle_m)
