"""A level site: the grid of a building, asked with the sweeps of a level 2-D laser.

A single sweep tells little in a corridor. So who drives is followed by a LevelTracker, which
gathers the sweeps of the last metres over the robot's own odometry.
"""

from collections import Counter
from dataclasses import replace
from functools import cached_property
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.level.field import Field
from pipeline.level.fix import LevelFix
from pipeline.level.level_map import LevelMap
from pipeline.level.sweeps import Gathered, Gatherer, single
from pipeline.level.verdict import LevelJudge
from pipeline.mapping.appearance import is_level
from pipeline.matching.ranking import Ranking
from pipeline.online import odometry
from pipeline.online.inputs import Scan
from pipeline.online.site import (
    RUNNERS_UP,
    WORDS,
    Fix,
    RunnerUp,
    Site,
    Word,
    promised,
)
from pipeline.online.site_file import LevelParts
from pipeline.online.site_json import LevelDescription
from pipeline.paths.belief import Belief

FEW = 20
"""So few points may be of any laser; they make no pose."""
NO_PLACE = -1
PATIENCE = 3
"""Sweeps in a row that may fail to be followed before the robot is lost."""


class LevelSite(Site):
    """A building that level sweeps can be localised in."""

    is_level = True

    description: LevelDescription  # type: ignore[assignment]  # what both have is what is asked

    def __init__(self, parts: LevelParts) -> None:
        """Build a level site from the content of its file."""
        self.description = parts.description
        level = parts.description.level
        x_m, y_m, yaw_rad = level.origin
        occupancy = np.asarray(parts.arrays["occupancy"], np.int8)
        self.level_map = LevelMap(occupancy, level.cell_m, (x_m, y_m, yaw_rad))
        self.field = Field.of(self.level_map)
        self.over_m = level.over_m
        self.level_fixer = level.fixer
        verdict = parts.description.verdict
        self.level_judge = LevelJudge(verdict.pose, verdict.place)
        self.promises = promised(verdict)

    @cached_property
    def walls_m(self) -> NDArray[np.float64]:
        """The middles (n, 3) of the cells that are walls, in the world, at z = 0."""
        cells = np.argwhere(self.level_map.walls)[:, ::-1]
        grid_m = (cells + 0.5) * self.level_map.cell_m
        world_T_grid = self.level_map.world_T_grid
        world_m = grid_m @ world_T_grid[:2, :2].T + world_T_grid[:2, 3]
        return np.column_stack([world_m, np.zeros(len(world_m))])

    def localize(self, points_m: NDArray[np.floating], promise: float | None = 0.99) -> Fix:
        """Localise a single sweep's hits (n, 2) or (n, 3) in metres: x forward, y left.

        Raises InputError for a 3-D scan, or a promise that the site cannot make.
        """
        start = perf_counter()
        self.check(promise)
        gathered = single(level_points(points_m))
        level_fix = self.level_fixer.fix(self.field, gathered)
        fix = self.judge_level(level_fix, promise)
        return replace(self.upright(fix, gathered, level_fix), ms=1e3 * (perf_counter() - start))

    def upright(self, fix: Fix, gathered: Gathered, level_fix: LevelFix) -> Fix:
        """The fix, rejected where its laser may be mounted otherwise than was said."""
        if fix.verdict not in WORDS:
            return fix
        ordered = level_fix.ordered(self.level_judge.pose)
        if not self.level_fixer.is_misread(self.field, gathered, ordered):
            return fix
        return replace(
            fix, verdict="rejected", novelty=1.0, place_novelty=1.0, promised_precision=None
        )

    def rank(self, points_m: NDArray[np.float64]) -> Ranking:
        """A level site ranks no places; raises InputError."""
        raise InputError("a level site: it has no places to rank, only a map to search")

    def judge_level(self, level_fix: LevelFix, promise: float | None) -> Fix:
        """The fix of gathered sweeps, with the verdict that a promise allows."""
        ordered = level_fix.ordered(self.level_judge.pose)
        if not ordered.hypotheses:
            nowhere = np.full((4, 4), np.nan)
            return Fix(
                "no pose", NO_PLACE, nowhere, np.full((6, 6), np.nan), 0.0, 1.0, 1.0, None, (), 0.0
            )
        best = ordered.hypotheses[0]
        doubts = self.level_judge.doubts(ordered).astype(np.float32).astype(np.float64)
        verdict, promised_precision = self.believed(doubts, promise)
        chances = self.level_judge.chances(ordered)
        runners_up = tuple(
            RunnerUp(NO_PLACE, other.world_T_query, other.support.explained, float(chance))
            for other, chance in list(zip(ordered.hypotheses, chances, strict=True))[
                1 : RUNNERS_UP + 1
            ]
        )
        return Fix(
            verdict,
            NO_PLACE,
            best.world_T_query,
            best.pose_covariance,
            best.support.explained,
            float(doubts[0]),
            float(doubts[1]),
            promised_precision,
            runners_up,
            0.0,
        )


class LevelTracker:
    """Follows a robot through a level site: its sweeps are gathered over odometry.

    If `is_tracking`, each fix is judged by all sweeps before it too, and sought where the robot is
    believed; else each is the fix of the gathered sweeps alone, sought everywhere.
    """

    def __init__(
        self, site: LevelSite, promise: float | None = 0.99, is_tracking: bool = True
    ) -> None:
        """Raises InputError for a promise that the site cannot make; None accepts nothing."""
        site.check(promise)
        self.site = site
        self.is_tracking = is_tracking
        self.steps = Counter[bool]()
        """How many sweeps came with odometry from the sweep before, and how many without."""
        self._promise = promise
        self._gatherer = Gatherer()
        self._belief = Belief(site.description.verdict.unseen_share)
        self._pose: NDArray[np.float64] | None = None
        self._misses = 0
        self._previous_scan: Scan | None = None

    @property
    def is_lost(self) -> bool:
        """Whether no pose is believed from which to go on."""
        return self._pose is None

    def follow(self, scan: Scan, points_m: NDArray[np.floating]) -> Fix:
        """The fix of the next sweep and its hits (n, 3), by its own odometry."""
        driven = odometry.step(self._previous_scan, scan)
        self._previous_scan = scan
        self.steps[driven is not None] += 1
        return self.localize(points_m, driven)

    def localize(
        self, points_m: NDArray[np.floating], step: NDArray[np.float64] | None = None
    ) -> Fix:
        """The fix of the next sweep (n, 2) or (n, 3); `step` (4, 4) is the odometry since the last.

        Without odometry the sweep is taken alone. Raises InputError for a 3-D scan.
        """
        start = perf_counter()
        self._gatherer.add(level_points(points_m), step)
        gathered = self._gatherer.gathered(self.site.over_m)
        if self.is_tracking:
            fix = self._tracked(gathered, step)
        else:
            level_fix = self.site.level_fixer.fix(self.site.field, gathered)
            fix = self.site.judge_level(level_fix, self._promise)
            fix = self.site.upright(fix, gathered, level_fix)
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _tracked(self, gathered: Gathered, step: NDArray[np.float64] | None) -> Fix:
        """The fix of gathered sweeps, given all before."""
        if step is None:
            self._pose = None
            self._belief = Belief(self._belief.unseen_share)
        else:
            self._belief.move(step)
        guess = None if self._pose is None or step is None else self._pose @ step
        if guess is not None:
            level_fix = self.site.level_fixer.track(self.site.field, gathered, guess)
        else:
            level_fix = self.site.level_fixer.fix(self.site.field, gathered)
        fix = self.site.judge_level(level_fix, self._promise)
        if guess is None or gathered.is_contradicted:
            fix = self.site.upright(fix, gathered, level_fix)
        if fix.verdict == "no pose":
            self._pose = guess
            return fix
        chance = float(np.clip(1 - fix.novelty, 1e-6, 1 - 1e-6))
        believed = self._belief.see(fix.world_T_sensor, chance, guess is not None)
        kept_promises = [promise for promise in self.site.promises if believed >= promise]
        verdict: Word = "accepted" if self._promise in kept_promises else "rejected"
        if verdict == "accepted":
            self._pose = fix.world_T_sensor
            self._misses = 0
        elif guess is not None:
            self._misses += 1
            self._pose = guess
            if self._misses >= PATIENCE:
                self._pose = None
                self._gatherer.restart()
        elif fix.verdict in ("near", "ambiguous"):
            verdict = fix.verdict
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - believed,
            promised_precision=max(kept_promises, default=None),
        )


def level_points(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The hits (n, 2) of a level sweep.

    Raises InputError for anything of another shape or type, and for a 3-D scan.
    """
    points_m = np.asarray(points_m)
    if points_m.ndim != 2 or points_m.shape[1] not in (2, 3) or points_m.dtype.kind not in "fiu":
        raise InputError(
            f"points of shape {points_m.shape} and type {points_m.dtype}: expected numbers (n, 2) "
            "or (n, 3), in metres"
        )
    points_m = points_m.astype(np.float64)
    points_m = points_m[np.isfinite(points_m).all(axis=1)]
    if points_m.shape[1] == 3 and len(points_m) > FEW and not is_level([points_m]):
        raise InputError(
            f"a 3-D scan, its points lie over {np.ptp(points_m[:, 2]):.1f} m of height: this site "
            "is level, it takes the sweeps of a level 2-D laser"
        )
    return np.ascontiguousarray(points_m[:, :2])
