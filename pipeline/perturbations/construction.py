"""Construction: adds new walls to a query's points, with or without their shadows (SCI paper, Fig.
9; METHODS 2.8).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Positive, Range, Seed, checked
from pipeline.perturbations import UNCHANGED, Case

CONSTRUCTION = "construction"
"""`Case.change` of queries with new walls."""
OWN_M = 1e-6
"""A point at most this far behind a wall's plane belongs to the wall itself."""
SKEW = Range(0, 90 - 1e-9, wording="an angle from 0 to below 90")
"""The angles in degrees by which walls may be skewed."""


@dataclass(frozen=True)
@checked("perturbation")
class Construction:
    """Adds the points of upright walls; with shadows, removes the points behind them.

    The dimensions of a wall are drawn uniformly between the bounds below.
    """

    walls: Sequence[int] = (1, 2, 3)
    """Numbers of walls, one case each. A query's first walls are the same in all cases."""
    shadows: Sequence[bool] = (False, True)
    """Whether the points that a new wall hides from the sensor are removed, including those of
    other new walls; one case each."""
    seed: Seed = 0
    """See `pipeline.perturbations.generator`."""
    nearest_m: Positive = 5.0
    """Least distance from the sensor to the middle of a wall."""
    farthest_m: float = 20.0
    """Largest distance from the sensor to the middle of a wall."""
    shortest_m: Positive = 5.0
    """Least length of a wall."""
    longest_m: float = 20.0
    """Largest length of a wall."""
    lowest_m: float = 3.0
    """Least height of a wall."""
    highest_m: float = 10.0
    """Largest height of a wall."""
    skew_deg: Annotated[float, SKEW] = 30.0
    """Largest angle, either way, between a wall's normal and the ray to its middle."""
    spacing_m: Positive = 0.2
    """Distance between neighbouring points of a wall, along it and upwards."""
    sensor_height_m: float = 1.3
    """Height of the sensor above the origin, from which shadows are cast; the default is the height
    on the simulated campus's robot."""

    def __post_init__(self) -> None:
        for name in ("walls", "shadows"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.walls or not all(isinstance(count, int) and count > 0 for count in self.walls):
            raise ConfigError(
                f"perturbation.walls={list(self.walls)}: expected whole numbers above 0"
            )
        if not self.shadows or set(self.shadows) - {False, True}:
            raise ConfigError(
                f"perturbation.shadows={list(self.shadows)}: expected false, true or both"
            )
        for low, high in (
            ("nearest_m", "farthest_m"),
            ("shortest_m", "longest_m"),
            ("lowest_m", "highest_m"),
        ):
            if not getattr(self, low) <= getattr(self, high):
                raise ConfigError(
                    f"perturbation.{low}={getattr(self, low)}, {high}={getattr(self, high)}: "
                    "expected a range"
                )
        if not 0 <= self.sensor_height_m < self.lowest_m:
            raise ConfigError(
                f"perturbation.sensor_height_m={self.sensor_height_m}: expected 0 to below "
                f"lowest_m={self.lowest_m}"
            )

    @property
    def cases(self) -> Sequence[Case]:
        """The unperturbed case; then a case for each number of walls, without and with shadows."""
        cases = [Case()]
        for shadow in self.shadows:
            cases += [Case(CONSTRUCTION, float(count), shadow) for count in self.walls]
        return tuple(cases)

    def perturb(
        self, case: Case, points_m: NDArray[np.floating], rng: np.random.Generator
    ) -> tuple[NDArray[np.floating], float]:
        """Append the points of `case.level` walls, with shadows remove hidden points; no turn."""
        if case.change == UNCHANGED:
            return points_m, 0.0
        walls = self.random_walls(int(case.level), rng)
        points = np.concatenate([points_m, *(wall.points(self.spacing_m) for wall in walls)])
        if case.shadow:
            is_hidden = np.any([wall.hides(points, self.sensor_height_m) for wall in walls], axis=0)
            points = points[~is_hidden]
        return points, 0.0

    def random_walls(self, count: int, rng: np.random.Generator) -> list["Wall"]:
        """Draw `count` random walls, with all numbers of a wall before the numbers of the next."""
        skew_rad = math.radians(self.skew_deg)
        low = (0.0, self.nearest_m, self.shortest_m, self.lowest_m, -skew_rad)
        high = (2 * math.pi, self.farthest_m, self.longest_m, self.highest_m, skew_rad)
        return [Wall(*numbers) for numbers in rng.uniform(low, high, (count, len(low))).tolist()]


class Wall(NamedTuple):
    """An upright rectangle that stands on the ground, z = 0; the sensor is on the z axis."""

    azimuth_rad: float
    """Azimuth of its middle."""
    distance_m: float
    """Distance of its middle from the z axis."""
    length_m: float
    height_m: float
    skew_rad: float
    """Turn from facing the sensor squarely, counter-clockwise seen from above."""

    @property
    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors (2,) in the xy plane: square to the wall away from the sensor, and along it.

        The second points to the left, seen from the sensor.
        """
        c = math.cos(self.azimuth_rad + self.skew_rad)
        s = math.sin(self.azimuth_rad + self.skew_rad)
        return np.array([c, s]), np.array([-s, c])

    @property
    def middle_m(self) -> tuple[float, float]:
        """Coordinates of its middle along these axes."""
        return self.distance_m * math.cos(self.skew_rad), -self.distance_m * math.sin(self.skew_rad)

    def points(self, spacing_m: float) -> NDArray[np.float64]:
        """Points (n, 3) every `spacing_m`, from its right end to the left and from its base up."""
        (away_m, left_m) = self.middle_m
        (away, along) = self.axes
        along_m = left_m - self.length_m / 2 + np.arange(0, self.length_m, spacing_m)
        z_m = np.arange(0, self.height_m, spacing_m)
        xy_m = away_m * away + along_m[:, None] * along
        return np.column_stack([np.repeat(xy_m, len(z_m), axis=0), np.tile(z_m, len(along_m))])

    def hides(self, points_m: NDArray[np.floating], sensor_height_m: float) -> NDArray[np.bool_]:
        """True for the points (n, 3) that the wall hides from a sensor at this height."""
        (away_m, left_m) = self.middle_m
        (away, along) = self.axes
        x, y, z = points_m.T
        point_away_m = away[0] * x + away[1] * y
        is_hidden: NDArray[np.bool_] = point_away_m > away_m + OWN_M
        # Find where the rays to the points behind the wall's plane cross the plane. A wall has no
        # lower edge, so nothing is seen below it.
        behind = np.flatnonzero(is_hidden)
        share = away_m / point_away_m[behind]
        crossing_left_m = share * (along[0] * x[behind] + along[1] * y[behind])
        crossing_z_m = sensor_height_m + share * (z[behind] - sensor_height_m)
        is_within_ends = np.abs(crossing_left_m - left_m) <= self.length_m / 2
        is_hidden[behind] = is_within_ends & (crossing_z_m <= self.height_m)
        return is_hidden
