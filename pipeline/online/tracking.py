"""Follows a robot along its path through a site of 3-D scans (METHODS 10.3).

For each scan a `Tracker`

1. moves what is believed (paths/belief.py) by the step of odometry since the last scan, or without
   odometry by a predicted step; after LONGEST_S seconds without odometry it forgets the robot;
2. registers the scan from the predicted pose, if the robot is tracked; if it is lost, ranks places
   and searches the whole map;
3. judges the fix by what is believed of all scans so far;
4. tracks the robot from an accepted fix on; after PATIENCE scans without one it is lost.

A track starts only from a fix that its own scan's verdict accepts, and until the robot has moved on
from there every other fix must be accepted by its own scan too.

`Motion` predicts the steps of a robot without odometry.
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
from pipeline.paths.belief import LEAST_CHANCE, Belief
from pipeline.posing.fix import Fix as Registered
from pipeline.posing.search import Answers

PATIENCE = 3
"""The robot is lost after so many scans in a row whose fix was not accepted."""
LIKELY = 0.9
"""A fix that is believed so much tells how the robot moves, accepted or not."""
SHORTEST_S = 0.02
LONGEST_S = 5.0
"""Two fixes tell how fast a robot moves if so many seconds lie between them, at least and at most.
After more than LONGEST_S a robot without odometry may be anywhere. Scans without stamps count as
one second apart."""
FASTEST_M_S = 40.0
FASTEST_DEG_S = 180.0
"""No robot moves or turns faster."""
STANDING_M = 0.5
"""Odometry may move by this in no time, since stamps are not exact."""
ACCELERATIONS = np.array([2.0, 15.0])
"""Standard deviations of a robot's acceleration in m/s² and °/s², until fixes have shown them."""
UNKNOWN_SPEEDS = np.array([FASTEST_M_S, FASTEST_DEG_S]) / 3
"""Standard deviations of the speed of a robot, in m/s and °/s, while it is unknown: the fastest is
three of them."""


class Motion:
    """Predicts how a robot without odometry moves on: as between its last two fixes."""

    def __init__(self) -> None:
        self._last_fix: tuple[NDArray[np.float64], float] | None = None  # its pose and its time
        self._since_fix_s = 0.0
        # by the last two fixes that told a speed
        self._speed_m_s = np.zeros(3)  # in the robot's frame
        self._turn_rad_s = np.zeros(3)  # a rotation vector
        self._fix_interval_s = 0.0  # 0 while the speed is unknown
        # how the robot accelerated since: sums of squares in m/s² and °/s², and how many;
        # ACCELERATIONS count as the first
        self._acceleration_squares = ACCELERATIONS**2
        self._acceleration_count = 1

    def predict(self, took_s: float) -> NDArray[np.float64]:
        """The step (4, 4) that the robot makes in `took_s` seconds at the speed of the last fixes.

        Where the clock jumped back or far ahead, the time between the last two fixes that told a
        speed is taken. Without such fixes the robot is predicted to stand still.
        """
        seconds = self._plausible_s(took_s)
        step = np.eye(4)
        step[:3, 3] = seconds * self._speed_m_s
        step[:3, :3] = Rotation.from_rotvec(seconds * self._turn_rad_s).as_matrix()
        return step

    def doubt(self, took_s: float) -> tuple[float, float]:
        """The standard deviations of the step predicted for `took_s`, in metres and degrees.

        If the robot accelerates by a, the prediction is off by ½ a t² at t seconds after the last
        fix. So the share of one step is ½ a (t₁² − t₀²), with t₀ and t₁ before and after it.
        """
        if not self._fix_interval_s:
            away_m, turn_deg = UNKNOWN_SPEEDS * max(self._plausible_s(took_s), SHORTEST_S)
            return float(away_m), float(turn_deg)
        hidden_step = np.zeros(2)
        if self._plausible_s(took_s) < SHORTEST_S:
            # it may be the same scan again, or the clock stands still while the robot moves on
            turn_deg_s = np.rad2deg(np.linalg.norm(self._turn_rad_s))
            speeds = np.array([np.linalg.norm(self._speed_m_s), turn_deg_s])
            hidden_step = self._fix_interval_s * speeds
        before_s = self._since_fix_s
        after_s = before_s + self._counted_s(took_s)
        acceleration = np.sqrt(self._acceleration_squares / self._acceleration_count)
        away_m, turn_deg = hidden_step + acceleration / 2 * (after_s**2 - before_s**2)
        return float(away_m), float(turn_deg)

    def advance(self, took_s: float) -> None:
        """Count a predicted step of `took_s` seconds as made since the last fix."""
        self._since_fix_s += self._counted_s(took_s)

    def note_fix(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Take note of a fix (4, 4) that is believed, and of its time.

        If the fix before is between SHORTEST_S and LONGEST_S seconds old, the two tell the speed,
        and how far the prediction was off.
        """
        last_fix = self._last_fix
        self._last_fix = (world_T_robot, time_s)
        self._since_fix_s = 0.0
        if last_fix is None:
            return
        world_T_last, last_s = last_fix
        seconds = time_s - last_s
        if not SHORTEST_S <= seconds <= LONGEST_S:
            return
        step = np.linalg.inv(world_T_last) @ world_T_robot
        speed_m_s = step[:3, 3] / seconds
        turn_rad_s = Rotation.from_matrix(step[:3, :3]).as_rotvec() / seconds
        is_too_fast = np.linalg.norm(speed_m_s) > FASTEST_M_S
        if is_too_fast or np.linalg.norm(turn_rad_s) > np.deg2rad(FASTEST_DEG_S):
            return
        if self._fix_interval_s:
            # a = 2 d / t², as `doubt` has it
            off_m, off_deg = distance_and_turn(self.predict(seconds)[None], step[None])
            acceleration = 2 * np.array([off_m[0], off_deg[0]]) / seconds**2
            self._acceleration_squares = self._acceleration_squares + acceleration**2
            self._acceleration_count += 1
        self._speed_m_s = speed_m_s
        self._turn_rad_s = turn_rad_s
        self._fix_interval_s = seconds

    def _plausible_s(self, took_s: float) -> float:
        """The time of a step. Where it is negative or long, the time between the last two fixes
        that told a speed; while none did, this is 0.
        """
        return took_s if 0 <= took_s <= LONGEST_S else self._fix_interval_s

    def _counted_s(self, took_s: float) -> float:
        """The time by which a step's doubt grows; too short a time counts as that between fixes."""
        seconds = self._plausible_s(took_s)
        return self._fix_interval_s if seconds < SHORTEST_S else seconds


class Tracker:
    """Follows a robot through a site: each fix is judged by all scans so far."""

    def __init__(self, site: Site, promise: float | None = 0.99) -> None:
        """Raises InputError for a promise that the site cannot make; None accepts nothing."""
        if site.is_level:
            raise InputError("a level site: a LevelTracker follows its sweeps")
        site.check(promise)
        self.site = site
        self._promise = promise
        self.belief = Belief(site.description.verdict.unseen_share)
        self.mode: Literal["lost", "tracking"] = "lost"
        self.steps = Counter[bool]()
        """How many scans came with odometry since the scan before (True), and without (False)."""
        self._pose: NDArray[np.float64] | None = None  # world_T_robot, from which it is tracked
        self._motion = Motion()
        self._start_views = 0  # how many views were believed where the track started
        self._misses = 0  # scans in a row whose fix was not accepted, while tracked
        self._stamp_ns: int | None = None  # of the last scan
        self._time_s = 0.0  # of the last scan; without stamps a second a scan
        self._previous_scan: Scan | None = None

    def follow(self, scan: Scan, points_m: NDArray[np.floating]) -> Fix:
        """The fix of the next scan, whose points are (n, 3), by its own odometry and stamp."""
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
        """The fix of the next scan (n, 3) in metres: x forward, y left, z up, ground at z = 0.

        `step` (4, 4) is its pose in the frame of the last scan, by odometry. Without odometry, or
        if no robot makes such a step in the time between the stamps, the robot is taken to move on
        as between its last two fixes. After more than LONGEST_S seconds without odometry it may be
        anywhere, and is searched for in the whole map.
        """
        start = perf_counter()
        points_m = finite(points_m)
        took_s = None
        if stamp_ns is not None and self._stamp_ns is not None:
            took_s = (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        self._time_s = self._time_s + 1.0 if stamp_ns is None else stamp_ns / 1e9

        step = self._move_belief(step, took_s)
        predicted_pose = None if self._pose is None else self._pose @ step
        registered, is_tracked = self._find(points_m, predicted_pose)
        fix = self._judge(registered, is_tracked)

        if fix.verdict != "no pose" and fix.chance >= LIKELY:
            self._motion.note_fix(fix.world_T_sensor, self._time_s)
        if fix.verdict == "accepted":
            if not is_tracked:
                self._start_views = self.belief.views
            self._pose = fix.world_T_sensor
            self._misses = 0
            self.mode = "tracking"
        elif predicted_pose is not None:
            self._misses += 1
            self._pose = predicted_pose if self._misses < PATIENCE else None
            self.mode = "lost" if self._pose is None else "tracking"
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _move_belief(
        self, step: NDArray[np.float64] | None, took_s: float | None
    ) -> NDArray[np.float64]:
        """Move what is believed by a step of odometry, or without one by a predicted step.

        `took_s` is the time of the step; None if it is unknown. Returns the step (4, 4). Forgets
        the robot after more than LONGEST_S seconds without odometry.
        """
        if step is not None and np.isfinite(step).all() and _is_driven(step, took_s):
            self.belief.move(step)
            return step
        if took_s is not None and took_s > LONGEST_S:
            # what was believed says nothing of where the robot has gone
            self._pose = None
            self.belief = Belief(self.belief.unseen_share)
        passed_s = 1.0 if took_s is None else took_s
        predicted_step = self._motion.predict(passed_s)
        self.belief.move(predicted_step, self._motion.doubt(passed_s))
        self._motion.advance(passed_s)
        return predicted_step

    def _find(
        self, points_m: NDArray[np.float64], predicted_pose: NDArray[np.float64] | None
    ) -> tuple[Registered, bool]:
        """Register a scan (n, 3): from a predicted pose (4, 4), or in the whole map.

        Returns also whether it was from that pose alone. The whole map is searched if no pose is
        predicted, or nothing fits there and the robot would be lost.
        """
        if predicted_pose is not None:
            registered = self.site.fixer.track(points_m, self.site.targets, predicted_pose)
            if registered.hypotheses or self._misses + 1 < PATIENCE:
                return registered, True
        answers = Answers.of(self.site.rank(points_m))
        return self.site.register(points_m, answers), False

    def _judge(self, registered: Registered, is_tracked: bool) -> Fix:
        """The fix of a registered scan, believed or not given all scans before."""
        fix = self.site.judge(registered, self._promise)
        if fix.verdict == "no pose":
            return fix
        chance_by_scan = float(np.clip(fix.chance, LEAST_CHANCE, 1 - LEAST_CHANCE))
        chance = self.belief.see(fix.world_T_sensor, chance_by_scan, is_tracked)
        by_path = is_tracked and self.belief.views > self._start_views
        kept_promises = self.site.kept_along_path(fix, chance, by_path)
        verdict: Word = "accepted" if self._promise in kept_promises else "rejected"
        if verdict == "rejected" and not is_tracked and fix.verdict in ("near", "ambiguous"):
            # both need rival poses, which are looked for in the whole map only: not while tracked
            verdict = fix.verdict
        # the fix may have slipped from where the robot was believed to be
        world_R_sensor = fix.world_T_sensor[:3, :3]
        covariance = fix.covariance.copy()
        covariance[3:, 3:] += world_R_sensor.T @ self.belief.slipped_m2() @ world_R_sensor
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - chance,
            promised_precision=max(kept_promises, default=None),
            covariance=covariance,
        )


def _is_driven(step: NDArray[np.float64], took_s: float | None) -> bool:
    """Whether a robot can make a step (4, 4) in a time; True if the time is unknown."""
    if took_s is None:
        return True
    return float(np.linalg.norm(step[:3, 3])) <= FASTEST_M_S * max(took_s, 0.0) + STANDING_M
