"""A level site: the map of a building, in which the sweeps of a level 2-D laser are localised.

A single sweep tells little in a corridor. So a robot that drives is followed by a `LevelTracker`,
which gathers the sweeps of the last metres by the robot's odometry (METHODS 13.5).
"""

from collections import Counter
from dataclasses import replace
from functools import cached_property
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import moved
from pipeline.level.field import Field
from pipeline.level.fix import LevelFix
from pipeline.level.level_map import LevelMap
from pipeline.level.sweeps import Gathered, Gatherer, single
from pipeline.level.verdict import OF_SWEEPS
from pipeline.mapping.appearance import is_level
from pipeline.matching.ranking import Ranking
from pipeline.online import odometry
from pipeline.online.inputs import Scan
from pipeline.online.site import (
    NO_PLACE,
    WORDS,
    Fix,
    Site,
    Word,
)
from pipeline.online.site_file import LevelParts
from pipeline.online.site_json import LevelDescription
from pipeline.paths.belief import LEAST_CHANCE, Belief
from pipeline.posing.verdict import Judge

FEW_POINTS = 20
"""So few points do not tell a level sweep from a 3-D scan; they make no pose anyway."""
PATIENCE = 3
"""The robot is lost after so many sweeps in a row whose fix was not accepted."""


class LevelSite(Site):
    """A building in which level sweeps can be localised."""

    is_level = True

    # callers use only what both kinds of site describe
    description: LevelDescription  # type: ignore[assignment]

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
        self.doubt_judge = Judge(verdict.pose, verdict.place, OF_SWEEPS)
        self.promises = verdict.limits

    @cached_property
    def walls_m(self) -> NDArray[np.float64]:
        """The middles (n, 3) of the cells that are walls, in metres in the world, at z = 0."""
        cells = np.argwhere(self.level_map.walls)[:, ::-1]  # column, row
        grid_m = (cells + 0.5) * self.level_map.cell_m
        world_m = moved(self.level_map.world_T_grid, grid_m)
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
        """The fix, or its rejection if the laser may be mounted otherwise than was said.

        `gathered` and `level_fix` are what the fix was judged by.
        """
        if fix.verdict not in WORDS:
            return fix
        ordered = level_fix.ordered(self.doubt_judge.pose)
        if not self.level_fixer.is_misread(self.field, gathered, ordered):
            return fix
        return replace(
            fix, verdict="rejected", novelty=1.0, place_novelty=1.0, promised_precision=None
        )

    def rank(self, points_m: NDArray[np.float64]) -> Ranking:
        """A level site ranks no places; raises InputError."""
        raise InputError("a level site: it has no places to rank, only a map to search")

    def judge_level(self, level_fix: LevelFix, promise: float | None) -> Fix:
        """The fix of gathered sweeps, with the verdict that a promise allows.

        Its time is yet to be filled in.
        """
        return self.judge(level_fix.ordered(self.doubt_judge.pose), promise)

    def place(self, world_T_query: NDArray[np.float64]) -> int:
        """A level site has no places."""
        return NO_PLACE


class LevelTracker:
    """Follows a robot through a level site, gathering its sweeps by odometry.

    If `is_tracking`, a fix is sought where the robot is believed to be, and judged by all sweeps so
    far; it starts as tracking.py says. Otherwise each fix is that of the gathered sweeps alone,
    sought in the whole map.
    """

    def __init__(
        self, site: LevelSite, promise: float | None = 0.99, is_tracking: bool = True
    ) -> None:
        """Raises InputError for a promise that the site cannot make; None accepts nothing."""
        site.check(promise)
        self.site = site
        self.is_tracking = is_tracking
        self.steps = Counter[bool]()
        """How many sweeps came with odometry since the sweep before (True), and without (False)."""
        self._promise = promise
        self._gatherer = Gatherer()
        self._belief = Belief(site.description.verdict.unseen_share)
        self._pose: NDArray[np.float64] | None = None  # world_T_robot, from which it is tracked
        self._start_views = 0  # how many views were believed where the track started
        self._misses = 0  # sweeps in a row whose fix was not accepted, while tracked
        self._previous_scan: Scan | None = None

    @property
    def is_lost(self) -> bool:
        """Whether there is no pose to track the robot from."""
        return self._pose is None

    def follow(self, scan: Scan, points_m: NDArray[np.floating]) -> Fix:
        """The fix of the next sweep, with its hits (n, 3) and the odometry of its log."""
        driven = odometry.step(self._previous_scan, scan)
        self._previous_scan = scan
        self.steps[driven is not None] += 1
        return self.localize(points_m, driven)

    def localize(
        self, points_m: NDArray[np.floating], step: NDArray[np.float64] | None = None
    ) -> Fix:
        """The fix of the next sweep's hits (n, 2) or (n, 3), in metres.

        `step` (4, 4) is its pose in the frame of the last sweep, by odometry. Without odometry the
        sweep is localised alone. Raises InputError for a 3-D scan.
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
        """The fix of gathered sweeps, given all sweeps before."""
        site = self.site
        # move what is believed; without odometry the robot may be anywhere
        guess = None
        if step is None:
            self._pose = None
            self._belief = Belief(self._belief.unseen_share)
        else:
            self._belief.move(step)
            guess = None if self._pose is None else self._pose @ step
        # localise: at the predicted pose, or in the whole map
        if guess is None:
            level_fix = site.level_fixer.fix(site.field, gathered)
        else:
            level_fix = site.level_fixer.track(site.field, gathered, guess)
        fix = site.judge_level(level_fix, self._promise)
        if guess is None or gathered.is_contradicted:
            fix = site.upright(fix, gathered, level_fix)
        if fix.verdict == "no pose":
            self._pose = guess
            return fix
        # judge the fix by what is believed
        chance_by_sweeps = float(np.clip(fix.chance, LEAST_CHANCE, 1 - LEAST_CHANCE))
        chance = self._belief.see(fix.world_T_sensor, chance_by_sweeps, tracked=guess is not None)
        by_path = guess is not None and self._belief.views > self._start_views
        kept_promises = site.kept_along_path(fix, chance, by_path)
        verdict: Word = "accepted" if self._promise in kept_promises else "rejected"
        if verdict == "rejected" and guess is None and fix.verdict in ("near", "ambiguous"):
            # both need rival poses, which are looked for in the whole map only: not while tracked
            verdict = fix.verdict
        # track on from here, or be lost after too many misses
        if verdict == "accepted":
            if guess is None:
                self._start_views = self._belief.views
            self._pose = fix.world_T_sensor
            self._misses = 0
        elif guess is not None:
            self._misses += 1
            self._pose = guess
            if self._misses >= PATIENCE:
                self._pose = None
                self._gatherer.restart()
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - chance,
            promised_precision=max(kept_promises, default=None),
        )


def level_points(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The finite hits (n, 2) of a level sweep's points (m, 2) or (m, 3), in metres.

    Raises InputError for points of another shape or type, and for a 3-D scan.
    """
    points_m = np.asarray(points_m)
    if points_m.ndim != 2 or points_m.shape[1] not in (2, 3) or points_m.dtype.kind not in "fiu":
        raise InputError(
            f"points of shape {points_m.shape} and type {points_m.dtype}: expected numbers (n, 2) "
            "or (n, 3), in metres"
        )
    points_m = points_m.astype(np.float64)
    points_m = points_m[np.isfinite(points_m).all(axis=1)]
    if points_m.shape[1] == 3 and len(points_m) > FEW_POINTS and not is_level([points_m]):
        raise InputError(
            f"a 3-D scan, its points lie over {np.ptp(points_m[:, 2]):.1f} m of height: this site "
            "is level, it takes the sweeps of a level 2-D laser"
        )
    return np.ascontiguousarray(points_m[:, :2])
