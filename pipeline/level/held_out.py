"""Held-out fixes: stretches of the training day, each localised on the map without it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.schemas import Scans
from pipeline.core.settings import Count, Positive, check
from pipeline.level.field import Field
from pipeline.level.fix import LevelFix, LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.sweeps import Gathered, Gatherer
from pipeline.level.verdict import LevelEvidence
from pipeline.mapping.appearance import LOOKED_AT, is_level


@dataclass(frozen=True)
class Sweeps:
    """The sweeps of a drive."""

    points: Callable[[int], NDArray[np.floating]]
    """Hits (n, 2 or 3) of one sweep, in metres, in the robot's frame."""
    world_T_sweep: NDArray[np.float64]
    """(sweep, 4, 4)."""
    odom_T_sweep: NDArray[np.float64]
    """(sweep, 4, 4) by odometry alone; NaN where there is none."""

    @classmethod
    def of(cls, scans: Scans, is_posed: bool = False) -> Self:
        """The sweeps of a scans artifact; of those with a true pose alone if `is_posed`."""
        world_T_scan = scans.load("world_T_scan")
        rows = np.arange(len(world_T_scan))
        if is_posed:
            rows = np.flatnonzero(np.isfinite(world_T_scan).all(axis=(1, 2)))
        points = scans.load("points")
        offsets = scans.load("offsets")
        grain_m = scans.grain_m
        return cls(
            lambda row: points[offsets[rows[row]] : offsets[rows[row] + 1]] * grain_m,
            world_T_scan[rows],
            scans.load("odom_T_scan")[rows],
        )

    @property
    def is_level(self) -> bool:
        """Whether they are of a level laser, by some of them."""
        rows = np.unique(np.linspace(0, len(self.world_T_sweep) - 1, LOOKED_AT).astype(int))
        return is_level(self.points(row) for row in rows.tolist())

    def step(self, row: int) -> NDArray[np.float64] | None:
        """The odometry (4, 4) since the sweep before; None if unknown."""
        if row == 0:
            return None
        step = np.linalg.inv(self.odom_T_sweep[row - 1]) @ self.odom_T_sweep[row]
        return np.asarray(step) if np.isfinite(step).all() else None

    def part(self, first: int, last: int) -> "Sweeps":
        """The sweeps from `first` to before `last`."""
        return Sweeps(
            lambda row: self.points(first + row),
            self.world_T_sweep[first:last],
            self.odom_T_sweep[first:last],
        )

    def gathered(self, rows: Sequence[int], over_m: float) -> dict[int, Gathered]:
        """The sweeps gathered over so many metres of path before each of some rows."""
        wanted = set(rows)
        gatherer = Gatherer()
        gathered_by_row: dict[int, Gathered] = {}
        for row in range(max(wanted, default=-1) + 1):
            gatherer.add(np.asarray(self.points(row), np.float64), self.step(row))
            if row in wanted:
                gathered_by_row[row] = gatherer.gathered(over_m)
        return gathered_by_row


@dataclass(frozen=True)
class LevelHeldOut:
    """Which sweeps of the training day are held out, as if they were queries of another day."""

    every_m: Positive = 2.5
    """Path from one query to the next: each is a block, as of 3-D fixes."""
    most: Count = 60
    """Queries, evenly along the path."""
    around_m: Sequence[float] = (8.0, 16.0)
    """Each is asked once more without the sweeps nearer than one of these, each in its turn: as a
    place never seen."""

    def __post_init__(self) -> None:
        check(self, "level.held_out")

    def evidence(
        self, fixer: LevelFixer, sweeps: Sweeps, drawing: Drawing, over_m: float
    ) -> LevelEvidence:
        """Fix each query on the map without its own sweeps, and without its surroundings."""
        path_m = travelled_m(sweeps.world_T_sweep)
        count = int(min(self.most, path_m[-1] // self.every_m))
        places_m = np.linspace(over_m, path_m[-1], max(count, 1))
        rows = np.unique(np.searchsorted(path_m, places_m).clip(0, len(path_m) - 1))
        gathered = sweeps.gathered(rows.tolist(), over_m)
        fixes: list[LevelFix] = []
        for number, row in enumerate(rows.tolist()):
            own = (path_m <= path_m[row]) & (path_m >= path_m[row] - gathered[row].path_m - 1e-6)
            away_m = np.linalg.norm(
                sweeps.world_T_sweep[:, :2, 3] - sweeps.world_T_sweep[row, :2, 3], axis=1
            )
            around = away_m < self.around_m[number % len(self.around_m)]
            for left_out in (own, own | around):
                fixes.append(_fix_without(fixer, drawing, left_out, gathered[row]))
        return LevelEvidence(
            fixes,
            sweeps.world_T_sweep[rows].repeat(2, axis=0),
            np.tile([False, True], len(rows)),
            np.arange(len(rows)).repeat(2),
        )


def travelled_m(world_T_sweep: NDArray[np.float64]) -> NDArray[np.float64]:
    """The path (sweep,) up to each sweep."""
    steps_m = np.linalg.norm(np.diff(world_T_sweep[:, :2, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def _fix_without(
    fixer: LevelFixer, drawing: Drawing, left_out: NDArray[np.bool_], gathered: Gathered
) -> LevelFix:
    try:
        level_map = drawing.level_map(left_out)
    except InputError:  # nothing is left
        return LevelFix()
    return fixer.fix(Field.of(level_map), gathered)
