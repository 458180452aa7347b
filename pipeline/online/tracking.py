"""Follows a robot along its path through a site (METHODS 10.3, of level sweeps 13.5).

For each scan a `Tracker`

1. moves what is believed (paths/belief.py) by the step of odometry since the last scan, or without
   odometry by what the site's kind of drive makes of that: it predicts the step (motion.py) or
   forgets the robot;
2. seeks the scan at the predicted pose, if the robot is tracked; if it is lost, in the whole map;
3. judges the fix by what is believed of all scans so far;
4. tracks the robot from an accepted fix on; after PATIENCE scans without one it is lost.

A track starts only from a fix that its own scan's verdict accepts, and until the robot has moved on
from there every other fix must be accepted by its own scan too.
"""

from collections import Counter
from dataclasses import replace
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.online import odometry
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site, Word
from pipeline.paths.belief import LEAST_PROBABILITY, Belief
from pipeline.posing.verdict import AnyFix

PATIENCE = 3
"""The robot is lost after so many scans in a row whose fix was not accepted."""
LIKELY = 0.9
"""A fix that is believed so much tells how the robot moves, accepted or not."""


class Tracker:
    """Follows a robot through a site: each fix is judged by all scans so far.

    A site of 3-D scans seeks each scan, a level site the sweeps of the last metres, gathered by
    odometry. If not `is_tracking`, each is sought in the whole map and judged alone.
    """

    def __init__(
        self, site: Site, target_precision: float | None = 0.99, is_tracking: bool = True
    ) -> None:
        """Raises InputError for a target precision that the site has no threshold for; None accepts
        nothing."""
        site.check(target_precision)
        self.site = site
        self.is_tracking = is_tracking
        self._target_precision = target_precision
        self.belief = Belief(site.description.verdict.unseen_share)
        self.steps = Counter[bool]()
        """How many scans came with odometry since the scan before (True), and without (False)."""
        self._drive = site.drive()
        self._pose: NDArray[np.float64] | None = None  # world_T_robot, from which it is tracked
        self._start_views = 0  # how many views were believed where the track started
        self._misses = 0  # scans in a row whose fix was not accepted, while tracked
        self._stamp_ns: int | None = None  # of the last scan
        self._time_s = 0.0  # of the last scan; without stamps a second a scan
        self._previous_scan: Scan | None = None

    @property
    def is_lost(self) -> bool:
        """Whether there is no pose to track the robot from."""
        return self._pose is None

    @property
    def mode(self) -> Literal["lost", "tracking"]:
        """What the tracker does with the next scan, in a word."""
        return "lost" if self.is_lost else "tracking"

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

        Of a level site it is a sweep's hits (n, 2) or (n, 3). `step` (4, 4) is the scan's pose in
        the frame of the last one, by odometry. Without odometry a sweep is localised alone; with
        3-D scans, or if no robot makes such a step in the time between the stamps, the robot is
        taken to move on as between its last two fixes, and to be anywhere after a long pause.
        Raises InputError for points of another shape, in a level site for a 3-D scan too.
        """
        start = perf_counter()
        query = self._drive.query(self.site.points(points_m), step)
        took_s = None
        if stamp_ns is not None and self._stamp_ns is not None:
            took_s = (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        self._time_s = self._time_s + 1.0 if stamp_ns is None else stamp_ns / 1e9
        if self.is_tracking:
            fix = self._tracked(query, step, took_s)
        else:
            fix = self.site.judge_query(query, self.site.seek(query), self._target_precision)
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _tracked(self, query: Any, step: NDArray[np.float64] | None, took_s: float | None) -> Fix:
        """The fix of a query of the site, given all scans before."""
        predicted_pose = self._predict(step, took_s)
        registered, is_tracked = self._find(query, predicted_pose)
        fix = self.site.judge_query(query, registered, self._target_precision, is_tracked)
        fix = self._judged_along_path(fix, is_tracked)
        if fix.verdict != "no pose" and fix.probability >= LIKELY:
            self._drive.note_fix(fix.world_T_sensor, self._time_s)
        if fix.verdict == "accepted":
            if not is_tracked:
                self._start_views = self.belief.views
            self._pose = fix.world_T_sensor
            self._misses = 0
            return fix
        self._pose = predicted_pose
        is_missed = fix.verdict != "no pose" or self._drive.counts_no_pose
        if predicted_pose is not None and is_missed:
            self._misses += 1
            if self._misses >= PATIENCE:
                self._pose = None
                self._drive.lose()
        return fix

    def _predict(
        self, step: NDArray[np.float64] | None, took_s: float | None
    ) -> NDArray[np.float64] | None:
        """Move what is believed by a step; returns the pose (4, 4) that is predicted, if any."""
        before_T_now, deviations, is_anywhere = self._drive.step(step, took_s)
        if is_anywhere:
            # what was believed says nothing of where the robot has gone
            self._pose = None
            self.belief = Belief(self.belief.unseen_share)
        self.belief.move(before_T_now, deviations)
        return None if self._pose is None else self._pose @ before_T_now

    def _find(self, query: Any, predicted_pose: NDArray[np.float64] | None) -> tuple[AnyFix, bool]:
        """Seek a query at a predicted pose (4, 4), or in the whole map; returns also whether there.

        The whole map is searched if no pose is predicted, or nothing fits there and the robot would
        be lost.
        """
        if predicted_pose is not None:
            registered = self.site.track(query, predicted_pose)
            if registered.hypotheses or self._misses + 1 < PATIENCE:
                return registered, True
        return self.site.seek(query), False

    def _judged_along_path(self, fix: Fix, is_tracked: bool) -> Fix:
        """The fix of a scan, believed or not given all scans before."""
        if fix.verdict == "no pose":
            return fix
        probability_by_scan = float(
            np.clip(fix.probability, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
        )
        probability = self.belief.see(fix.world_T_sensor, probability_by_scan, is_tracked)
        by_path = is_tracked and self.belief.views > self._start_views
        met_precisions = self.site.kept_along_path(fix, probability, by_path)
        verdict: Word = "accepted" if self._target_precision in met_precisions else "rejected"
        if verdict == "rejected" and not is_tracked and fix.verdict in ("near", "ambiguous"):
            # both need rival poses, which are looked for in the whole map only: not while tracked
            verdict = fix.verdict
        covariance = fix.covariance.copy()
        if self._drive.widens:
            # the fix may have slipped from where the robot was believed to be
            world_R_sensor = fix.world_T_sensor[:3, :3]
            covariance[3:, 3:] += world_R_sensor.T @ self.belief.slipped_m2() @ world_R_sensor
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - probability,
            accepted_at=max(met_precisions, default=None),
            covariance=covariance,
        )


LevelTracker = Tracker
"""The name of the tracker of level sites, from when they had their own."""
