"""The campus on one day: its season, its parked cars, and its moving people and cars."""

from dataclasses import dataclass, replace
from datetime import date

import numpy as np
from numpy.typing import NDArray

from pipeline.world import Floats
from pipeline.world.driving.clutter import clutter
from pipeline.world.driving.scene import Scene, build_scene
from pipeline.world.layout.campus import Campus, shapes_on
from pipeline.world.layout.ground import Ground
from pipeline.world.layout.shapes import BOX, CYLINDER, Kind, Records, Species, columns, records
from pipeline.world.layout.streets import Streets
from pipeline.world.seeds import Stream, generator

OCCUPANCIES = (0.15, 0.9)
OCCUPANCY_WAVE = 0.4
OCCUPANCY_WAVE_LENGTH_M = 60.0
CAR_SIZES_M = ((2.2, 0.9, 1.45), (2.35, 0.95, 1.75), (2.6, 1.0, 2.1))
"""Half length, half width and height."""
CAR_SHARES = (0.55, 0.33, 0.12)
CAR_SCALES = (0.95, 1.05)
CAR_REFLECTANCE = 0.35
CABIN_REFLECTANCE = 0.3
PARKING_SD_M = (0.15, 0.25)
PARKING_YAW_SD_RAD = 0.03

WALKERS_PER_STREET = 0.6
STREETS_PER_DRIVER = 20
WALKING_SPEEDS_MPS = (0.8, 1.7)
DRIVING_SPEEDS_MPS = (5.0, 11.0)
WALKER_RADIUS_M = 0.28
WALKER_HEIGHTS_M = (1.55, 1.9)
PERSON_REFLECTANCE = 0.3
DRIVER_LANE_M = 1.9
DRIVER_RADIUS_M = 0.95
DRIVER_PARTS_M = (-1.4, 0.0, 1.4)
MOVERS_WITHIN_M = 80.0

BARE_UNTIL = (4, 15)
FULL_FROM = (5, 30)
FULL_UNTIL = (9, 22)
BARE_FROM = (11, 14)
"""(month, day): leaves come out between the first two and fall between the last two, as in
Michigan."""

TWIGS_PER_M = 0.06
BARE_AND_LEAVES_PER_M = {
    Species.DECIDUOUS: (TWIGS_PER_M, 0.85),
    Species.CONIFER: (1.1, 0.0),
    Species.HEDGE: (0.5, 1.5),
    Species.PALES: (5.0, 0.0),
}
"""Extinction per metre of the twigs, and of all leaves, which adds to it; the free path of a ray is
−log(u) / extinction."""


@dataclass(frozen=True)
class Traffic:
    """People or cars, each moving along one line; at its end it starts again at the beginning."""

    starts_m: Floats
    """(n, 2) start of each one's line."""
    spans_m: Floats
    """(n, 2) vector from there to the end of the line."""
    phases: Floats
    """(n,) share of the line covered at time 0."""
    speeds_mps: Floats
    """(n,) negative towards the start of the line."""

    @staticmethod
    def along(
        rng: np.random.Generator,
        streets: Streets,
        rows: NDArray[np.int64],
        speeds_mps: tuple[float, float],
    ) -> "Traffic":
        """Random movers along the middle of the streets `rows` (n,), in either direction."""
        starts_m = streets.starts_m[rows]
        ends_m = streets.ends_m[rows]
        phases = rng.random(len(rows))
        signs = rng.choice([-1, 1], len(rows))
        return Traffic(
            starts_m, ends_m - starts_m, phases, signs * rng.uniform(*speeds_mps, len(rows))
        )

    def aside(self, left_m: Floats) -> "Traffic":
        """The same traffic, `left_m` (n,) to the left of its lines."""
        along_x, along_y = (self.spans_m / np.hypot(*self.spans_m.T)[:, None]).T
        return replace(
            self, starts_m=self.starts_m + left_m[:, None] * np.stack([-along_y, along_x], 1)
        )

    def at(self, time_s: float) -> tuple[Floats, Floats]:
        """Places (n, 2) in metres and the unit vectors (n, 2) along the lines."""
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
    drivers: Traffic

    def movers(self, time_s: float, robot_m: Floats, keep_off_m: float) -> Records:
        """People and moving cars as cylinders, `time_s` into the drive, near `robot_m` (2,) but not
        within `keep_off_m` of it."""
        cars_m, along = self.drivers.at(time_s)
        x_m, y_m = (
            (cars_m[:, None] + np.array(DRIVER_PARTS_M)[None, :, None] * along[:, None])
            .reshape(-1, 2)
            .T
        )
        people = people_at(self.walkers.at(time_s)[0], self.walker_heights_m, self.ground)
        base_m = self.ground.at(x_m, y_m)
        size = {"bottom_m": base_m + 0.2, "top_m": base_m + 1.5, "radius_m": DRIVER_RADIUS_M}
        cars = records(
            CYLINDER, x_m=x_m, y_m=y_m, reflectance=CAR_REFLECTANCE, kind=Kind.CAR, **size
        )
        movers: Records = np.concatenate([people, cars])
        gap_m = np.hypot(movers["x_m"] - robot_m[0], movers["y_m"] - robot_m[1])
        near: Records = movers[
            (gap_m < MOVERS_WITHIN_M) & (gap_m - movers["radius_m"] > keep_off_m)
        ]
        return near


def people_at(xy_m: Floats, heights_m: Floats, ground: Ground) -> Records:
    """People of `heights_m` (n,) standing at `xy_m` (n, 2)."""
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
    """The campus on the date `when`, which is `day` days after the training sequence."""
    rng = generator(seed, Stream.DAY, when)
    boxes, cylinders, crowns = shapes_on(campus, day)
    boxes = np.concatenate([boxes, _parked_cars(rng, campus, day)])
    if campus.spots:
        things, people = clutter(generator(seed, Stream.CLUTTER, when), campus, day)
        boxes = np.concatenate([boxes, things])
        cylinders = np.concatenate([cylinders, people])
    for porous in (boxes, crowns):
        porous["extinction_per_m"] = extinction_per_m(porous["species"], when, twigs_per_m)
    streets = campus.streets
    walked = rng.integers(0, len(streets.edges), int(WALKERS_PER_STREET * len(streets.edges)))
    walkers = Traffic.along(rng, streets, walked, WALKING_SPEEDS_MPS)
    walkers = walkers.aside(rng.uniform(-1, 1, len(walked)) * (streets.half_widths_m[walked] + 0.5))
    heights_m = rng.uniform(*WALKER_HEIGHTS_M, len(walked))
    roads = np.flatnonzero(~streets.is_path)
    driven = roads[
        rng.integers(
            0,
            max(len(roads), 1),
            max(3, len(streets.edges) // STREETS_PER_DRIVER) if len(roads) else 0,
        )
    ]
    drivers = Traffic.along(rng, streets, driven, DRIVING_SPEEDS_MPS)
    drivers = drivers.aside(-DRIVER_LANE_M * np.sign(drivers.speeds_mps))
    return Day(
        build_scene(boxes, cylinders, crowns, campus.ground, relief_m),
        campus.ground,
        walkers,
        heights_m,
        drivers,
    )


def _parked_cars(rng: np.random.Generator, campus: Campus, day: int) -> Records:
    """Cars in random open slots.

    The share of taken slots differs from day to day and, smoothly, from place to place.
    """
    x_m, y_m, yaw, dead_day = columns(campus.slots, "x_m", "y_m", "yaw_rad", "dead_day").values()
    phase_x, phase_y = rng.uniform(0, 2 * np.pi, 2)
    occupancy = rng.uniform(*OCCUPANCIES)
    waves = np.sin(x_m / OCCUPANCY_WAVE_LENGTH_M + phase_x) * np.sin(
        y_m / OCCUPANCY_WAVE_LENGTH_M + phase_y
    )
    chance = (occupancy + OCCUPANCY_WAVE * 0.5 * waves).clip(0.02, 0.97)
    is_taken = rng.random(len(yaw)) < chance
    models = rng.choice(len(CAR_SIZES_M), len(yaw), p=CAR_SHARES)
    sizes = np.array(CAR_SIZES_M)[models] * rng.uniform(*CAR_SCALES, (len(yaw), 1))
    places = np.stack([x_m, y_m, yaw], 1) + rng.normal(
        0, (*PARKING_SD_M, PARKING_YAW_SD_RAD), (len(yaw), 3)
    )
    is_taken &= dead_day > day
    (x_m, y_m, yaw) = places[is_taken].T
    (half_length_m, half_width_m, height_m) = sizes[is_taken].T
    base_m = campus.ground.at(x_m, y_m)
    c = np.cos(yaw)
    s = np.sin(yaw)
    turn = {"cos_yaw": c, "sin_yaw": s, "kind": Kind.CAR}
    hull = {
        "half_length_m": half_length_m,
        "half_width_m": half_width_m,
        "reflectance": CAR_REFLECTANCE,
    }
    cabin = {
        "half_length_m": 0.55 * half_length_m,
        "half_width_m": 0.88 * half_width_m,
        "reflectance": CABIN_REFLECTANCE,
    }
    hulls = records(
        BOX, x_m=x_m, y_m=y_m, bottom_m=base_m + 0.2, top_m=base_m + 0.6 * height_m, **turn, **hull
    )
    back_x = x_m - 0.2 * c
    back_y = y_m - 0.2 * s
    cabins = records(
        BOX,
        x_m=back_x,
        y_m=back_y,
        bottom_m=base_m + 0.55 * height_m,
        top_m=base_m + height_m,
        **turn,
        **cabin,
    )
    return np.concatenate([hulls, cabins])


def foliage(day: date) -> float:
    """The share of the leaves that are out on `day`, 0 to 1."""
    turns = [
        date(day.year, *turn).toordinal() for turn in (BARE_UNTIL, FULL_FROM, FULL_UNTIL, BARE_FROM)
    ]
    return float(np.interp(day.toordinal(), turns, [0.0, 1.0, 1.0, 0.0]))


def extinction_per_m(
    species: NDArray[np.int64], day: date, twigs_per_m: float = TWIGS_PER_M
) -> Floats:
    """Extinction (n,) of shapes of these `species` (n,) on `day`; solid ones get 0.

    `twigs_per_m`: of bare deciduous trees.
    """
    density = np.zeros(len(species))
    for kind, (bare, leaves) in BARE_AND_LEAVES_PER_M.items():
        density[species == kind] = (
            twigs_per_m if kind == Species.DECIDUOUS else bare
        ) + leaves * foliage(day)
    return density
