"""The campus on one day: the campus over the year and a date in, everything that a ray can hit out.

A day has its season, which decides how dense foliage is, its parked cars and clutter, and people
and cars that move.
"""

from dataclasses import dataclass, replace
from datetime import date

import numpy as np
from numpy.typing import NDArray

from worlds import Floats
from worlds.driving.clutter import clutter
from worlds.driving.scene import Scene, build_scene
from worlds.layout.campus import Campus, shapes_on
from worlds.layout.ground import Ground
from worlds.layout.shapes import BOX, CYLINDER, Kind, Records, Species, columns, records
from worlds.layout.streets import Streets
from worlds.seeds import Stream, generator

OCCUPANCY_BOUNDS = (0.15, 0.9)
"""Bounds of the share of the parking slots that are taken, which is drawn for each day."""
OCCUPANCY_WAVE = 0.4
"""Difference of this share between the places where it is highest and lowest: it follows a wave."""
OCCUPANCY_WAVE_LENGTH_M = 60.0
"""Length of this wave, over 2π."""
CAR_SIZES_M = ((2.2, 0.9, 1.45), (2.35, 0.95, 1.75), (2.6, 1.0, 2.1))
"""Half length, half width and height of three models."""
CAR_SHARES = (0.55, 0.33, 0.12)
"""The shares of these models."""
CAR_SCALE_BOUNDS = (0.95, 1.05)
"""Bounds of the size of a car relative to its model."""
CAR_CLEARANCE_M = 0.2
"""Height of the lower end of a car above the ground."""
CAR_REFLECTANCE = 0.35
CABIN_REFLECTANCE = 0.3
PARKING_SD_M = (0.15, 0.25)
"""Standard deviations of a parked car's x and y about its slot."""
PARKING_YAW_SD_RAD = 0.03

WALKERS_PER_STREET = 0.6
STREETS_PER_DRIVER = 20
WALKING_SPEED_BOUNDS_MPS = (0.8, 1.7)
DRIVING_SPEED_BOUNDS_MPS = (5.0, 11.0)
WALKER_RADIUS_M = 0.28
WALKER_HEIGHT_BOUNDS_M = (1.55, 1.9)
PERSON_REFLECTANCE = 0.3
DRIVER_LANE_M = 1.9
"""Distance of a moving car's lane from the middle of the road, on its right."""
DRIVER_RADIUS_M = 0.95
DRIVER_HEIGHT_M = 1.5
DRIVER_PARTS_M = (-1.4, 0.0, 1.4)
"""A moving car is three cylinders in a row; their distances ahead of its middle."""
MOVERS_WITHIN_M = 80.0
"""People and moving cars further from the robot than this are left out."""

BARE_UNTIL = (4, 15)
"""Month and day until which trees are bare; the dates are as in Michigan."""
FULL_FROM = (5, 30)
"""Month and day from which all leaves are out."""
FULL_UNTIL = (9, 22)
BARE_FROM = (11, 14)

TWIGS_PER_M = 0.06
"""Extinction of a bare deciduous tree."""
BARE_AND_LEAVES_PER_M = {
    Species.DECIDUOUS: (TWIGS_PER_M, 0.85),
    Species.CONIFER: (1.1, 0.0),
    Species.HEDGE: (0.5, 1.5),
    Species.PALES: (5.0, 0.0),
}
"""For each species its extinction per metre when bare, and what all leaves add to it. The free path
of a ray is −log(u) / extinction for a random u in (0, 1)."""


@dataclass(frozen=True)
class Traffic:
    """n people or cars that move along a line each, and start again at its end."""

    starts_m: Floats
    """(n, 2) the starts of the lines."""
    spans_m: Floats
    """(n, 2) the vectors from the starts to the ends of the lines."""
    phases: Floats
    """(n,) the share of the line that each has covered at time 0."""
    speeds_mps: Floats
    """(n,) the speeds, negative for those that move from the end of their line to its start."""

    @staticmethod
    def along(
        rng: np.random.Generator,
        streets: Streets,
        rows: NDArray[np.int64],
        speeds_mps: tuple[float, float],
    ) -> "Traffic":
        """Draw random movers along the middle of the streets `rows` (n,), in either direction."""
        starts_m = streets.starts_m[rows]
        ends_m = streets.ends_m[rows]
        phases = rng.random(len(rows))
        signs = rng.choice([-1, 1], len(rows))
        signed_mps = signs * rng.uniform(*speeds_mps, len(rows))
        return Traffic(starts_m, ends_m - starts_m, phases, signed_mps)

    def aside(self, left_m: Floats) -> "Traffic":
        """The same traffic, `left_m` (n,) to the left of its lines."""
        along_x, along_y = (self.spans_m / np.hypot(*self.spans_m.T)[:, None]).T
        left = np.stack([-along_y, along_x], 1)
        return replace(self, starts_m=self.starts_m + left_m[:, None] * left)

    def at(self, time_s: float) -> tuple[Floats, Floats]:
        """Places (n, 2) in metres at a time, and unit vectors (n, 2) along the lines."""
        lengths_m = np.hypot(*self.spans_m.T)
        share = (self.phases + self.speeds_mps * time_s / lengths_m) % 1.0
        return self.starts_m + share[:, None] * self.spans_m, self.spans_m / lengths_m[:, None]


@dataclass(frozen=True)
class Day:
    """Everything that a scan of this day can hit."""

    scene: Scene
    ground: Ground
    walkers: Traffic
    walker_heights_m: Floats
    """(walker,) the heights of the people."""
    drivers: Traffic
    """Moving cars."""

    def movers(self, time_s: float, robot_m: Floats, keep_off_m: float) -> Records:
        """The cylinders of people and moving cars, `time_s` into the drive.

        Only those near the robot at `robot_m` (2,) are given, but none within `keep_off_m` of it.
        """
        walkers_m, _ = self.walkers.at(time_s)
        people = people_at(walkers_m, self.walker_heights_m, self.ground)

        cars_m, along = self.drivers.at(time_s)
        parts_m = cars_m[:, None] + np.array(DRIVER_PARTS_M)[None, :, None] * along[:, None]
        x_m, y_m = parts_m.reshape(-1, 2).T
        base_m = self.ground.at(x_m, y_m)
        size = {
            "bottom_m": base_m + CAR_CLEARANCE_M,
            "top_m": base_m + DRIVER_HEIGHT_M,
            "radius_m": DRIVER_RADIUS_M,
        }
        cars = records(
            CYLINDER, x_m=x_m, y_m=y_m, reflectance=CAR_REFLECTANCE, kind=Kind.CAR, **size
        )

        movers: Records = np.concatenate([people, cars])
        distance_m = np.hypot(movers["x_m"] - robot_m[0], movers["y_m"] - robot_m[1])
        is_off = distance_m - movers["radius_m"] > keep_off_m
        near_movers: Records = movers[(distance_m < MOVERS_WITHIN_M) & is_off]
        return near_movers


def people_at(xy_m: Floats, heights_m: Floats, ground: Ground) -> Records:
    """The cylinders of people of `heights_m` (n,) at `xy_m` (n, 2)."""
    x_m, y_m = xy_m.T
    base_m = ground.at(x_m, y_m)
    size = {"radius_m": WALKER_RADIUS_M, "bottom_m": base_m, "top_m": base_m + heights_m}
    return records(
        CYLINDER, x_m=x_m, y_m=y_m, reflectance=PERSON_REFLECTANCE, kind=Kind.PERSON, **size
    )


def simulate_day(
    seed: int,
    campus: Campus,
    when: date,
    day: int,
    relief_m: float = 0.0,
    twigs_per_m: float = TWIGS_PER_M,
) -> Day:
    """Simulate the campus on the date `when`, which is `day` days after the training sequence.

    `relief_m` is how far parts of walls lie before or behind their planes, and `twigs_per_m` the
    extinction of bare deciduous trees.
    """
    # 1. Gather what stands on this day.
    rng = generator(seed, Stream.DAY, when)
    boxes, cylinders, crowns = shapes_on(campus, day)
    boxes = np.concatenate([boxes, _parked_cars(rng, campus, day)])
    if campus.spots:
        things, people = clutter(generator(seed, Stream.CLUTTER, when), campus, day)
        boxes = np.concatenate([boxes, things])
        cylinders = np.concatenate([cylinders, people])
    for shapes in (boxes, crowns):
        shapes["extinction_per_m"] = extinction_per_m(shapes["species"], when, twigs_per_m)

    # 2. Let people walk along any street, and cars drive on the right of roads.
    streets = campus.streets
    n_streets = len(streets.edges)
    walked_streets = rng.integers(0, n_streets, int(WALKERS_PER_STREET * n_streets))
    walkers = Traffic.along(rng, streets, walked_streets, WALKING_SPEED_BOUNDS_MPS)
    # up to half a metre beyond either border of the street
    half_widths_m = streets.half_widths_m[walked_streets] + 0.5
    walkers = walkers.aside(rng.uniform(-1, 1, len(walked_streets)) * half_widths_m)
    heights_m = rng.uniform(*WALKER_HEIGHT_BOUNDS_M, len(walked_streets))
    roads = np.flatnonzero(~streets.is_path)
    n_drivers = max(3, n_streets // STREETS_PER_DRIVER) if len(roads) else 0
    driven_roads = roads[rng.integers(0, max(len(roads), 1), n_drivers)]
    drivers = Traffic.along(rng, streets, driven_roads, DRIVING_SPEED_BOUNDS_MPS)
    # The right of a car that drives from the end of its line to the start is the line's left.
    drivers = drivers.aside(-DRIVER_LANE_M * np.sign(drivers.speeds_mps))
    return Day(
        scene=build_scene(boxes, cylinders, crowns, campus.ground, relief_m),
        ground=campus.ground,
        walkers=walkers,
        walker_heights_m=heights_m,
        drivers=drivers,
    )


def _parked_cars(rng: np.random.Generator, campus: Campus, day: int) -> Records:
    """The boxes of parked cars in random open slots, a hull and a cabin for each car."""
    slots = columns(campus.slots, "x_m", "y_m", "yaw_rad", "dead_day")
    x_m = slots["x_m"]
    y_m = slots["y_m"]
    yaw_rad = slots["yaw_rad"]
    phase_x, phase_y = rng.uniform(0, 2 * np.pi, 2)
    occupancy = rng.uniform(*OCCUPANCY_BOUNDS)
    waves = np.sin(x_m / OCCUPANCY_WAVE_LENGTH_M + phase_x) * np.sin(
        y_m / OCCUPANCY_WAVE_LENGTH_M + phase_y
    )
    share_taken = (occupancy + OCCUPANCY_WAVE * 0.5 * waves).clip(0.02, 0.97)
    n_slots = len(yaw_rad)
    is_taken = rng.random(n_slots) < share_taken
    models = rng.choice(len(CAR_SIZES_M), n_slots, p=CAR_SHARES)
    sizes = np.array(CAR_SIZES_M)[models] * rng.uniform(*CAR_SCALE_BOUNDS, (n_slots, 1))
    deviations = rng.normal(0, (*PARKING_SD_M, PARKING_YAW_SD_RAD), (n_slots, 3))
    places = np.stack([x_m, y_m, yaw_rad], 1) + deviations
    is_taken &= slots["dead_day"] > day  # from then on a construction site closes the slot

    (x_m, y_m, yaw_rad) = places[is_taken].T
    (half_length_m, half_width_m, height_m) = sizes[is_taken].T
    base_m = campus.ground.at(x_m, y_m)
    c = np.cos(yaw_rad)
    s = np.sin(yaw_rad)
    hulls = records(
        BOX,
        x_m=x_m,
        y_m=y_m,
        half_length_m=half_length_m,
        half_width_m=half_width_m,
        cos_yaw=c,
        sin_yaw=s,
        bottom_m=base_m + CAR_CLEARANCE_M,
        top_m=base_m + 0.6 * height_m,
        kind=Kind.CAR,
        reflectance=CAR_REFLECTANCE,
    )
    # A cabin is shorter than the hull, stands a little behind its middle, and reaches into it.
    cabins = records(
        BOX,
        x_m=x_m - 0.2 * c,
        y_m=y_m - 0.2 * s,
        half_length_m=0.55 * half_length_m,
        half_width_m=0.88 * half_width_m,
        cos_yaw=c,
        sin_yaw=s,
        bottom_m=base_m + 0.55 * height_m,
        top_m=base_m + height_m,
        kind=Kind.CAR,
        reflectance=CABIN_REFLECTANCE,
    )
    return np.concatenate([hulls, cabins])


def foliage(day: date) -> float:
    """The share of the leaves that are out on a date, from 0 to 1."""
    turning_points = (BARE_UNTIL, FULL_FROM, FULL_UNTIL, BARE_FROM)
    ordinals = [date(day.year, *month_and_day).toordinal() for month_and_day in turning_points]
    return float(np.interp(day.toordinal(), ordinals, [0.0, 1.0, 1.0, 0.0]))


def extinction_per_m(
    species: NDArray[np.int64], day: date, twigs_per_m: float = TWIGS_PER_M
) -> Floats:
    """Extinction (n,) per metre of shapes of these `species` (n,) on a date; solid ones get 0.

    `twigs_per_m` is that of bare deciduous trees.
    """
    extinction = np.zeros(len(species))
    for porous_species, (bare_per_m, leaves_per_m) in BARE_AND_LEAVES_PER_M.items():
        if porous_species == Species.DECIDUOUS:
            bare_per_m = twigs_per_m
        extinction[species == porous_species] = bare_per_m + leaves_per_m * foliage(day)
    return extinction
