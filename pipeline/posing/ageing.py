"""Ageing: a held-out scan as a later day would see it, so that a verdict learns from more than its own day (METHODS 9.5).

New walls and what they hide, a wedge in which nothing is left, leaves and snow: the strengths are fixed beforehand, never by a
result.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations.construction import Construction
from pipeline.errors import ConfigError
from pipeline.posing.registration import Points
from pipeline.running.settings import NotNegative, Share, check


@dataclass(frozen=True)
class Ageing:
    """How much changes, at most; each query draws its own."""

    walls: int = 2
    """New walls, with what they hide: 0 to this many, each as likely."""
    wedge_deg: NotNegative = 90.0
    """Width of the directions in which nothing is left, up to this, in every other query."""
    above: Share = 0.3
    """Share of the points above `above_m` that are gone, up to this: leaves fall."""
    below: Share = 0.1
    """The same of the others: snow, cars, people."""
    above_m: NotNegative = 2.0
    construction: Construction = field(default_factory=lambda: Construction(spacing_m=0.4))

    def __post_init__(self) -> None:
        check(self, "ageing")
        if self.walls < 0:
            raise ConfigError(f"ageing.walls={self.walls}: expected a number from 0 on")

    def aged(self, points_m: Points, rng: np.random.Generator) -> Points:
        """What is left of points (n, 3), z up from the ground around the sensor, and what has been built."""
        walls = self.construction.random_walls(int(rng.integers(0, self.walls + 1)), rng)
        for wall in walls:
            points_m = np.concatenate([points_m, wall.points(self.construction.spacing_m)])
        for wall in walls:
            points_m = points_m[~wall.hides(points_m, self.construction.sensor_height_m)]
        width_rad = np.deg2rad(rng.uniform(0, self.wedge_deg)) * rng.integers(0, 2)
        first_rad = rng.uniform(0, 2 * np.pi)
        bearing_rad = (np.arctan2(points_m[:, 1], points_m[:, 0]) - first_rad) % (2 * np.pi)
        points_m = points_m[bearing_rad >= width_rad]
        return points_m[rng.random(len(points_m)) >= self._gone(points_m, rng)]

    def _gone(self, points_m: Points, rng: np.random.Generator) -> NDArray[np.float64]:
        """The share (n,) of points such as each that is gone."""
        above, below = rng.uniform(0, self.above), rng.uniform(0, self.below)
        return np.where(points_m[:, 2] > self.above_m, above, below)
