"""Localises along a path.

Global fixes until one is believed, then registration from the predicted pose, until lost.
"""

from collections import Counter
from dataclasses import replace
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.errors import InputError
from pipeline.core.frames import distance_and_turn
from pipeline.online import odometry
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site, Word, finite
from pipeline.paths.belief import Belief
from pipeline.posing.fix import Fix as Registered
from pipeline.posing.search import Answers

PATIENCE = 3
"""Scans in a row that may fail to be tracked before the robot is lost."""
SHORTEST = 0.02
LONGEST = 5.0
"""Seconds between two fixes that tell how fast a robot moves, and after which a robot without
odometry may be anywhere; of scans without stamps so many scans."""
FASTEST_M = 40.0
FASTEST_DEG = 180.0
"""No robot moves or turns faster in a second: two such fixes tell no speed."""
STANDING_M = 0.5
"""Odometry may move so far in no time: stamps are not exact."""
GAINS = np.array([2.0, 15.0])
"""Standard deviations of a robot's acceleration, in metres and degrees a second squared, until
fixes have shown it."""
UNKNOWN = np.array([FASTEST_M, FASTEST_DEG]) / 3
"""Standard deviations a second of a robot of unknown speed."""
LIKELY = 0.9
"""A pose believed so much tells how fast the robot moves, though it may not be accepted."""


class Motion:
    """Predicts how a robot without odometry moves on: as between its last two fixes."""

    def __init__(self) -> None:
        self._last: tuple[NDArray[np.float64], float] | None = None
        self._moved_m = np.zeros(3)
        self._turned_rad = np.zeros(3)  # in a second, or from scan to scan
        self._fix_interval_s = 0.0
        self._since_fix_s = 0.0
        self._squares = GAINS**2
        self._fixes = 1

    def onwards(self, took_s: float) -> NDArray[np.float64]:
        """The predicted step (4, 4) in `took_s` seconds.

        Where the clock jumped back or far ahead, it is the step of the time between the last two
        fixes that told a speed.
        """
        seconds = took_s if 0 <= took_s <= LONGEST else self._fix_interval_s
        step = np.eye(4)
        step[:3, 3] = seconds * self._moved_m
        step[:3, :3] = Rotation.from_rotvec(seconds * self._turned_rad).as_matrix()
        return step

    def doubt(self, took_s: float) -> tuple[float, float]:
        """The standard deviations of the next step, in `took_s` seconds, in metres and degrees.

        The seconds are counted: each since the last fix adds more to what a robot may do otherwise.
        """
        seconds = took_s if 0 <= took_s <= LONGEST else self._fix_interval_s
        if not self._fix_interval_s:
            away_m, turn_deg = UNKNOWN * max(seconds, SHORTEST)
            return float(away_m), float(turn_deg)
        stood = np.zeros(2)
        if seconds < SHORTEST:  # the same scan again, or a clock that stands still
            stood = self._fix_interval_s * np.array(
                [np.linalg.norm(self._moved_m), np.rad2deg(np.linalg.norm(self._turned_rad))]
            )
            seconds = self._fix_interval_s
        before_s = self._since_fix_s
        self._since_fix_s = before_s + seconds
        away_m, turn_deg = stood + np.sqrt(self._squares / self._fixes) / 2 * (
            self._since_fix_s**2 - before_s**2
        )
        return float(away_m), float(turn_deg)

    def fixed(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Take note of a pose that is believed at a time."""
        last_fix = self._last
        self._last = (world_T_robot, time_s)
        self._since_fix_s = 0.0
        if last_fix is None or not SHORTEST <= time_s - last_fix[1] <= LONGEST:
            return
        seconds = time_s - last_fix[1]
        step = np.linalg.inv(last_fix[0]) @ world_T_robot
        moved_m = step[:3, 3] / seconds
        turned_rad = Rotation.from_matrix(step[:3, :3]).as_rotvec() / seconds
        if np.linalg.norm(moved_m) > FASTEST_M or np.linalg.norm(turned_rad) > np.deg2rad(
            FASTEST_DEG
        ):
            return
        if self._fix_interval_s:
            off_m, off_deg = distance_and_turn(self.onwards(seconds)[None], step[None])
            self._squares = self._squares + (2 * np.array([off_m[0], off_deg[0]]) / seconds**2) ** 2
            self._fixes += 1
        self._moved_m = moved_m
        self._turned_rad = turned_rad
        self._fix_interval_s = seconds


class Tracker:
    """Follows a robot through a site: each fix is judged by all scans so far.

    The thresholds are the site's own.
    """

    def __init__(self, site: Site, promise: float | None = 0.99) -> None:
        """Raises InputError for a promise that the site cannot make; None accepts nothing."""
        if site.is_level:
            raise InputError("a level site: a LevelTracker follows its sweeps")
        site.check(promise)
        self.site = site
        self._promise = promise
        self.belief = Belief(site.description.verdict.unseen_share)
        self.mode: Literal["lost", "tracking"] = "lost"
        self._pose: NDArray[np.float64] | None = None
        self._motion = Motion()
        self._misses = 0
        self._stamp_ns: int | None = None
        self._time_s = 0.0
        self._previous_scan: Scan | None = None
        self.steps = Counter[bool]()
        """How many scans were followed with odometry from the scan before, and how many without."""

    def follow(self, scan: Scan, points_m: NDArray[np.floating]) -> Fix:
        """The fix of the next scan and its points (n, 3), by its own odometry and stamp."""
        driven = odometry.step(self._previous_scan, scan)
        self._previous_scan = scan
        self.steps[driven is not None] += 1
        return self.localize(points_m, driven, scan.stamp_ns)

    def localize(
        self,
        points_m: NDArray[np.floating],
        step: NDArray[np.float64] | None = None,
        stamp_ns: int | None = None,
    ) -> Fix:
        """The fix of the next scan (n, 3); `step` (4, 4) is the odometry since the last scan.

        The step is the scan's pose in the last scan's frame. Without odometry, or after a step that
        no robot makes in the time, the robot is assumed to move on as between its last two fixes,
        for the time between the stamps. After more than LONGEST seconds it may be anywhere, and is
        searched for everywhere.
        """
        start = perf_counter()
        points_m = finite(points_m)
        took_s = (
            None
            if stamp_ns is None or self._stamp_ns is None
            else (stamp_ns - self._stamp_ns) / 1e9
        )
        self._stamp_ns = stamp_ns
        self._time_s = self._time_s + 1.0 if stamp_ns is None else stamp_ns / 1e9
        guessed = step is None or not np.isfinite(step).all() or not _is_driven(step, took_s)
        if guessed and took_s is not None and took_s > LONGEST:
            # what was believed of a robot says nothing of where it went
            self._pose = None
            self.belief = Belief(self.belief.unseen_share)
        if step is None or guessed:
            step = self._onwards(took_s)
            self.belief.move(step, self._motion.doubt(_passed_s(took_s)))
        else:
            self.belief.move(step)
        guess = None if self._pose is None else self._pose @ step
        registered, tracked = self._find(points_m, guess)
        fix = self._judge(registered, tracked)
        if fix.verdict != "no pose" and 1 - fix.novelty >= LIKELY:
            self._motion.fixed(fix.world_T_sensor, self._time_s)
        if fix.verdict == "accepted":
            self._pose = fix.world_T_sensor
            self._misses = 0
            self.mode = "tracking"
        elif guess is not None:
            self._misses += 1
            self._pose = guess if self._misses < PATIENCE else None
            self.mode = "lost" if self._pose is None else "tracking"
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _onwards(self, took_s: float | None) -> NDArray[np.float64]:
        """The predicted step (4, 4) since the last scan."""
        return self._motion.onwards(_passed_s(took_s))

    def _find(
        self, points_m: NDArray[np.float64], guess: NDArray[np.float64] | None
    ) -> tuple[Registered, bool]:
        """The hypotheses of a scan, and whether they come from the predicted pose alone."""
        if guess is not None:
            registered = self.site.fixer.track(points_m, self.site.targets, guess)
            if registered.hypotheses or self._misses + 1 < PATIENCE:
                return registered, True
        return self._search_everywhere(points_m), False

    def _search_everywhere(self, points_m: NDArray[np.float64]) -> Registered:
        return self.site.register(points_m, Answers.of(self.site.rank(points_m)))

    def _judge(self, registered: Registered, tracked: bool) -> Fix:
        """The fix of the best hypothesis, believed or not given all scans before."""
        fix = self.site.judge(registered, self._promise)
        if fix.verdict == "no pose":
            return fix
        chance = float(np.clip(1 - fix.novelty, 1e-6, 1 - 1e-6))
        believed = self.belief.see(fix.world_T_sensor, chance, tracked)
        kept_promises = [promise for promise in self.site.promises if believed >= promise]
        verdict: Word = "accepted" if self._promise in kept_promises else "rejected"
        if verdict == "rejected" and not tracked and fix.verdict in ("near", "ambiguous"):
            # of a tracked pose no rival was looked for, so its scan alone tells less
            verdict = fix.verdict
        axes = fix.world_T_sensor[:3, :3]
        covariance = fix.covariance.copy()
        covariance[3:, 3:] += axes.T @ self.belief.slipped_m2() @ axes
        promised = max(kept_promises, default=None)
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - believed,
            promised_precision=promised,
            covariance=covariance,
        )


def _is_driven(step: NDArray[np.float64], took_s: float | None) -> bool:
    """Whether a robot can make a step in the time, True if the time is unknown."""
    return (
        took_s is None
        or float(np.linalg.norm(step[:3, 3])) <= FASTEST_M * max(took_s, 0.0) + STANDING_M
    )


def _passed_s(took_s: float | None) -> float:
    """The time since the last scan in seconds; 1 where there are no stamps."""
    return 1.0 if took_s is None else took_s
