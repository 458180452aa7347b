"""Construction: new walls, with or without the occlusion they cause (METHODS 2.8).

SCI paper, Fig. 9.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import AS_DRIVEN, Case
from pipeline.core.errors import ConfigError
from pipeline.core.settings import Positive, Seed, check

CONSTRUCTION = "construction"
OWN_M = 1e-6
"""A point no further behind a wall is the wall's own."""


@dataclass(frozen=True)
class Construction:
    """Adds the points of upright walls; with a shadow, removes the points behind them."""

    walls: Sequence[int] = (1, 2, 3)
    """Numbers of walls, a case each. A query's first walls are the same in all cases."""
    shadows: Sequence[bool] = (False, True)
    """Whether points that a new wall hides from the sensor are removed, those of the other new
    walls included."""
    seed: Seed = 0
    """See pipeline.alterations."""
    nearest_m: Positive = 5.0
    """Least distance from the sensor to the middle of a wall; all these ranges are sampled
    uniformly."""
    farthest_m: float = 20.0
    shortest_m: Positive = 5.0
    longest_m: float = 20.0
    lowest_m: float = 3.0
    """Height of a wall, at least."""
    highest_m: float = 10.0
    skew_deg: float = 30.0
    """Largest angle, either way, between a wall's normal and the ray to its middle."""
    spacing_m: Positive = 0.2
    """From one point of a wall to the next, along it and up."""
    sensor_height_m: float = 1.3
    """Where the rays of the shadows start, above the origin; the default is the simulated campus
    robot's."""

    def __post_init__(self) -> None:
        check(self, "alteration")
        for name in ("walls", "shadows"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.walls or not all(isinstance(count, int) and count > 0 for count in self.walls):
            raise ConfigError(
                f"alteration.walls={list(self.walls)}: expected whole numbers above 0"
            )
        if not self.shadows or set(self.shadows) - {False, True}:
            raise ConfigError(
                f"alteration.shadows={list(self.shadows)}: expected false, true or both"
            )
        for low, high in (
            ("nearest_m", "farthest_m"),
            ("shortest_m", "longest_m"),
            ("lowest_m", "highest_m"),
        ):
            if not getattr(self, low) <= getattr(self, high):
                raise ConfigError(
                    f"alteration.{low}={getattr(self, low)}, {high}={getattr(self, high)}: "
                    "expected a range"
                )
        if not 0 <= self.skew_deg < 90:
            raise ConfigError(
                f"alteration.skew_deg={self.skew_deg}: expected an angle from 0 to below 90"
            )
        if not 0 <= self.sensor_height_m < self.lowest_m:
            raise ConfigError(
                f"alteration.sensor_height_m={self.sensor_height_m}: expected 0 to below "
                f"lowest_m={self.lowest_m}"
            )

    @property
    def cases(self) -> Sequence[Case]:
        """As driven, then each number of walls without shadow, then with."""
        return (
            Case(),
            *(
                Case(CONSTRUCTION, float(count), shadow)
                for shadow in self.shadows
                for count in self.walls
            ),
        )

    def alter(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """The points (m, 3), behind them those of `case.level` walls, and no turn."""
        if case.change == AS_DRIVEN:
            return points_m, 0.0
        walls = self.random_walls(int(case.level), rng)
        points = np.concatenate([points_m, *(wall.points(self.spacing_m) for wall in walls)])
        if case.shadow:
            points = points[
                ~np.any([wall.hides(points, self.sensor_height_m) for wall in walls], axis=0)
            ]
        return points, 0.0

    def random_walls(self, count: int, rng: np.random.Generator) -> list["Wall"]:
        """`count` random walls."""
        skew_rad = math.radians(self.skew_deg)
        low = (0.0, self.nearest_m, self.shortest_m, self.lowest_m, -skew_rad)
        high = (2 * math.pi, self.farthest_m, self.longest_m, self.highest_m, skew_rad)
        return [Wall(*numbers) for numbers in rng.uniform(low, high, (count, len(low))).tolist()]


class Wall(NamedTuple):
    """An upright rectangle whose base lies on the ground, z = 0, around a sensor on the z axis."""

    azimuth_rad: float
    """Of its middle."""
    distance_m: float
    """To its middle."""
    length_m: float
    height_m: float
    skew_rad: float
    """How far it is turned, counter-clockwise from above, from standing square to the ray to its
    middle."""

    @property
    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions (2,) in the xy plane: away from the sensor, square to the wall, and along it.

        Along the wall is to the left.
        """
        c = math.cos(self.azimuth_rad + self.skew_rad)
        s = math.sin(self.azimuth_rad + self.skew_rad)
        return np.array([c, s]), np.array([-s, c])

    @property
    def middle_m(self) -> tuple[float, float]:
        """How far away its middle lies along each of the axes."""
        return self.distance_m * math.cos(self.skew_rad), -self.distance_m * math.sin(self.skew_rad)

    def points(self, spacing_m: float) -> NDArray[np.float64]:
        """Points (n, 3) every `spacing_m` from its right end and its base on."""
        (away_m, left_m) = self.middle_m
        (away, along) = self.axes
        on_m = np.arange(0, self.length_m, spacing_m)
        up_m = np.arange(0, self.height_m, spacing_m)
        xy_m = away_m * away + (left_m - self.length_m / 2 + on_m)[:, None] * along
        return np.column_stack([np.repeat(xy_m, len(up_m), axis=0), np.tile(up_m, len(on_m))])

    def hides(self, points_m: NDArray[np.floating], sensor_height_m: float) -> NDArray[np.bool_]:
        """Which points (n, 3) the wall hides from a sensor on the z axis; its base has no gap."""
        (away_m, left_m) = self.middle_m
        (away, along) = self.axes
        x, y, z = points_m.T
        square_m = away[0] * x + away[1] * y
        hidden: NDArray[np.bool_] = square_m > away_m + OWN_M
        behind = np.flatnonzero(hidden)
        share = away_m / square_m[behind]
        met_m = share * (along[0] * x[behind] + along[1] * y[behind])
        top_m = sensor_height_m + share * (z[behind] - sensor_height_m)
        hidden[behind] = (np.abs(met_m - left_m) <= self.length_m / 2) & (top_m <= self.height_m)
        return hidden
