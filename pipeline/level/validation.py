"""Localises stretches of the training day on the map without them, as evidence for a verdict.

In: the sweeps of the day. Out: `FixEvidence`, fixes with true poses, on which verdict.py tests its
thresholds (METHODS 13.4). Each validation query is localised twice: on the map without its own
sweeps, as at a known place; and without all sweeps around it, as at a novel place.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import travelled_m
from pipeline.core.schemas import Scans
from pipeline.core.settings import Count, Positive, checked
from pipeline.level.field import Field
from pipeline.level.fix import LevelFix, LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.sweeps import Gathered, Gatherer
from pipeline.mapping.appearance import MEASURED_SUBMAPS, is_level
from pipeline.posing.verdict import FixEvidence


@dataclass(frozen=True)
class Sweeps:
    """The sweeps of a drive, one after the other."""

    points: Callable[[int], NDArray[np.floating]]
    """Returns the hits (n, 2 or 3) of the sweep of a number, in metres, in the robot's frame."""
    world_T_sweep: NDArray[np.float64]
    """(sweep, 4, 4) true poses of the robot."""
    odom_T_sweep: NDArray[np.float64]
    """(sweep, 4, 4) the robot's poses by odometry alone; NaN where there is none."""

    @classmethod
    def of(cls, scans: Scans, is_posed: bool = False) -> Self:
        """The sweeps of a scans artifact; if `is_posed`, only those with a true pose."""
        world_T_scan = scans.load("world_T_scan")
        rows = np.arange(len(world_T_scan))
        if is_posed:
            rows = np.flatnonzero(np.isfinite(world_T_scan).all(axis=(1, 2)))
        points = scans.load("points")
        offsets = scans.load("offsets")
        grain_m = scans.grain_m

        def points_m(sweep: int) -> NDArray[np.floating]:
            row = rows[sweep]
            return np.asarray(points[offsets[row] : offsets[row + 1]] * grain_m)

        return cls(points_m, world_T_scan[rows], scans.load("odom_T_scan")[rows])

    @property
    def is_level(self) -> bool:
        """Whether the laser is level, judged by a few of the sweeps."""
        rows = np.unique(np.linspace(0, len(self.world_T_sweep) - 1, MEASURED_SUBMAPS).astype(int))
        return is_level(self.points(row) for row in rows.tolist())

    def step(self, row: int) -> NDArray[np.float64] | None:
        """The step (4, 4) of odometry from the sweep before to that of a row; None if unknown."""
        if row == 0:
            return None
        step = np.linalg.inv(self.odom_T_sweep[row - 1]) @ self.odom_T_sweep[row]
        return np.asarray(step) if np.isfinite(step).all() else None

    def part(self, first: int, last: int) -> "Sweeps":
        """The sweeps from number `first` to before `last`."""
        return Sweeps(
            lambda row: self.points(first + row),
            self.world_T_sweep[first:last],
            self.odom_T_sweep[first:last],
        )

    def gathered(self, rows: Sequence[int], over_m: float) -> dict[int, Gathered]:
        """By row, each of the sweeps `rows` with the sweeps of the `over_m` of path before it."""
        wanted = set(rows)
        gatherer = Gatherer()
        gathered_by_row: dict[int, Gathered] = {}
        for row in range(max(wanted, default=-1) + 1):
            gatherer.add(np.asarray(self.points(row), np.float64), self.step(row))
            if row in wanted:
                gathered_by_row[row] = gatherer.gathered(over_m)
        return gathered_by_row


@dataclass(frozen=True)
@checked("level.validation")
class LevelValidation:
    """Keeps sweeps of the training day for validation, as if they were queries of another day."""

    every_m: Positive = 2.5
    """Least path between two queries, so that they are independent evidence."""
    most: Count = 60
    """Largest number of queries; they are spaced evenly along the path."""
    around_m: Sequence[float] = (8.0, 16.0)
    """To make a novel place, the map of a query lacks all sweeps nearer than one of these
    distances; the queries take the distances in turn."""

    def evidence(
        self, fixer: LevelFixer, sweeps: Sweeps, drawing: Drawing, over_m: float
    ) -> FixEvidence[LevelFix]:
        """Localise each query on the map without its own sweeps, then without its surroundings.

        A query is gathered over `over_m` of path; `drawing` holds the beams of all sweeps.
        """
        path_m = travelled_m(sweeps.world_T_sweep[:, :2, 3])
        count = int(min(self.most, path_m[-1] // self.every_m))
        queried_at_m = np.linspace(over_m, path_m[-1], max(count, 1))
        rows = np.unique(np.searchsorted(path_m, queried_at_m).clip(0, len(path_m) - 1))
        gathered = sweeps.gathered(rows.tolist(), over_m)
        fixes: list[LevelFix] = []
        for number, row in enumerate(rows.tolist()):
            first_m = path_m[row] - gathered[row].path_m - 1e-6  # against rounding
            of_query = (path_m <= path_m[row]) & (path_m >= first_m)
            away_m = np.linalg.norm(
                sweeps.world_T_sweep[:, :2, 3] - sweeps.world_T_sweep[row, :2, 3], axis=1
            )
            around = away_m < self.around_m[number % len(self.around_m)]
            fixes.append(_fix_without(fixer, drawing, of_query, gathered[row]))
            fixes.append(_fix_without(fixer, drawing, of_query | around, gathered[row]))
        # two fixes for each query: at a known place, then at a novel place
        return FixEvidence(
            fixes,
            sweeps.world_T_sweep[rows].repeat(2, axis=0),
            np.tile([False, True], len(rows)),
            np.arange(len(rows)).repeat(2),
        )


def _fix_without(
    fixer: LevelFixer, drawing: Drawing, left_out: NDArray[np.bool_], gathered: Gathered
) -> LevelFix:
    """The fix of gathered sweeps on the map without the sweeps that are True in `left_out` (s,)."""
    try:
        level_map = drawing.level_map(left_out)
    except InputError:  # the remaining sweeps make no map
        return LevelFix()
    return fixer.fix(Field.of(level_map), gathered)
