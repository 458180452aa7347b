"""Tracks a robot along its path through a site (METHODS 10.3; level sweeps: 13.5).

For each scan a `Tracker`

1. moves its belief (paths/belief.py) by the step of odometry since the last scan. Without odometry
   it predicts the step (motion.py), or forgets the robot if it may be anywhere;
2. registers the scan at the predicted pose if the robot is tracked;
3. judges the fix by the belief, which combines all scans so far;
4. searches the whole map if the robot is lost or this fix is not accepted, and judges again;
5. tracks the robot from an accepted fix on. It is lost after PATIENCE scans without an accepted
   fix, or after one that its scan alone accepts elsewhere; nothing of what was believed is kept.

A fix is accepted as `Belief.most_precise` says: a track starts only from a fix that is accepted by
its own scan alone, and every further scan must agree with the map where it is accepted.
"""

from collections import Counter
from dataclasses import replace
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.online import odometry
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site, VerdictName
from pipeline.paths.belief import LEAST_PROBABILITY, Belief
from pipeline.posing.prior import Prior
from pipeline.posing.verdict import AnyFix

PATIENCE = 3
"""The robot is lost after this many scans in a row whose fix was not accepted."""
LIKELY = 0.9
"""A fix of at least this probability is used to predict motion, accepted or not."""


class Tracker:
    """Tracks a robot through a site: each fix is judged by all scans so far.

    A site of 3-D scans registers each scan, a level site the sweeps of the last metres, gathered by
    odometry. If not `is_tracking`, each query is registered in the whole map and judged alone.
    """

    def __init__(
        self,
        site: Site,
        target_precision: float | None = 0.99,
        is_tracking: bool = True,
        strict: bool = False,
    ) -> None:
        """Fixes are accepted at what the site keeps of the target precision, see
        `Site.kept_precision`; None accepts nothing. Raises InputError for a target precision that
        is not a share and, if `strict`, for one that the site has no threshold for."""
        self.site = site
        self.is_tracking = is_tracking
        self._target_precision = site.kept_precision(target_precision, strict)
        self.steps = Counter[bool]()
        """The number of scans with odometry since the scan before (True), and without (False)."""
        self._drive = site.drive()
        self.belief = self._no_belief()
        self.starts_track = False
        """Whether the last fix is accepted where the robot was not predicted: it was lost, or it
        was carried there."""
        self._pose: NDArray[np.float64] | None = None  # world_T_robot; None if the robot is lost
        self._misses = 0  # scans in a row whose fix was not accepted, while tracked
        self._stamp_ns: int | None = None  # of the last scan
        self._time_s = 0.0  # of the last scan; scans without stamps are one second apart
        self._previous_scan: Scan | None = None
        self._prior: Prior | None = None  # of the next scan

    @property
    def is_lost(self) -> bool:
        """Whether the robot's pose is unknown."""
        return self._pose is None

    @property
    def mode(self) -> Literal["lost", "tracking"]:
        """The state of the tracker in a word."""
        return "lost" if self.is_lost else "tracking"

    def restart(self, prior: Prior | None = None) -> None:
        """Forget where the robot is; the next scan is localised with a prior, if there is one."""
        self._lose()
        self._misses = 0
        self._drive.lose()
        self._prior = prior

    def follow(self, scan: Scan, points_m: NDArray[np.floating], prior: Prior | None = None) -> Fix:
        """The fix of the next scan, with its points (n, 3), and with its own odometry and stamp."""
        driven = odometry.step(self._previous_scan, scan)
        self._previous_scan = scan
        self.steps[driven is not None] += 1
        return self.localize(points_m, driven, scan.stamp_ns, prior)

    def localize(
        self,
        points_m: NDArray[np.floating],
        step: NDArray[np.float64] | None = None,
        stamp_ns: int | None = None,
        prior: Prior | None = None,
    ) -> Fix:
        """The fix of the next scan (n, 3) in metres: x forward, y left, z up, ground at z = 0.

        A level site takes a sweep's hits (n, 2) or (n, 3). `step` (4, 4) is the scan's pose in the
        frame of the last scan, by odometry. Without odometry, a sweep is localised alone, and the
        step of a 3-D scan is predicted from the last two fixes; after a long pause the robot may be
        anywhere. A robot that is lost is sought within a `prior` first. A step that no robot makes
        in the time between the stamps is not used. Raises InputError for points of another shape,
        and for a 3-D scan in a level site.
        """
        start = perf_counter()
        prior, self._prior = prior or self._prior, None
        query = self._drive.query(self.site.points(points_m), step)
        took_s = None
        if stamp_ns is not None and self._stamp_ns is not None:
            took_s = (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        self._time_s = self._time_s + 1.0 if stamp_ns is None else stamp_ns / 1e9
        if self.is_tracking:
            fix = self._tracked(query, step, took_s, prior)
        else:
            fix = self.site.find(query, self._target_precision, prior)
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _tracked(
        self,
        query: Any,
        step: NDArray[np.float64] | None,
        took_s: float | None,
        prior: Prior | None,
    ) -> Fix:
        """The fix of a query of the site, given all scans before."""
        predicted_pose = self._predict(step, took_s)
        fix = None
        is_elsewhere = False
        if predicted_pose is not None:
            registered = self.site.track(query, predicted_pose)
            fix, _ = self._judged(query, registered, is_tracked=True)
        if fix is None or fix.verdict != "accepted":
            registered = self.site.sought(query, self._target_precision, prior)
            sought, is_accepted_alone = self._judged(query, registered, is_tracked=False)
            is_elsewhere = is_accepted_alone and sought.verdict != "accepted"
            fix = sought if fix is None or sought.verdict != "no pose" else fix
        if fix.verdict != "no pose" and fix.probability >= LIKELY:
            self._drive.note_fix(fix.world_T_sensor, self._time_s)
        self.starts_track = fix.verdict == "accepted" and not self._is_near(fix, predicted_pose)
        if fix.verdict == "accepted":
            self._pose = fix.world_T_sensor
            self._misses = 0
            return fix
        self._pose = predicted_pose
        is_missed = fix.verdict != "no pose" or self._drive.counts_no_pose
        if predicted_pose is not None and is_missed:
            self._misses += 1
            if is_elsewhere or self._misses >= PATIENCE:
                self._lose()
        return fix

    def _is_near(self, fix: Fix, predicted_pose: NDArray[np.float64] | None) -> bool:
        """Whether the pose of a fix agrees with a predicted pose (4, 4)."""
        if predicted_pose is None:
            return False
        poses = fix.world_T_sensor[None], predicted_pose[None]
        return bool(self.site.claim_judge.tolerances.right(*poses)[0])

    def _lose(self) -> None:
        """Forget where the robot is."""
        self._pose = None
        self.belief = self._no_belief()

    def _predict(
        self, step: NDArray[np.float64] | None, took_s: float | None
    ) -> NDArray[np.float64] | None:
        """Move the belief by a step; returns the predicted pose (4, 4), None if it is lost."""
        before_T_now, deviations, is_anywhere = self._drive.step(step, took_s)
        if is_anywhere:
            # the belief says nothing of where the robot has gone
            self._pose = None
            self.belief = self._no_belief()
        self.belief.move(before_T_now, deviations)
        return None if self._pose is None else self._pose @ before_T_now

    def _no_belief(self) -> Belief:
        """The belief about a robot that may be anywhere."""
        return Belief(
            self.site.description.verdict.unseen_share,
            self.site.claim_judge.tolerances.right_within,
            self._drive.new_view_m,
        )

    def _judged(self, query: Any, registered: AnyFix, is_tracked: bool) -> tuple[Fix, bool]:
        """The fix of a registered query, and whether its own scan accepts it.

        `is_tracked` says that it was sought at a prediction.
        """
        alone = self.site.judge_query(query, registered, self._target_precision, is_tracked)
        return self._judged_along_path(alone, is_tracked), alone.verdict == "accepted"

    def _judged_along_path(self, fix: Fix, is_tracked: bool) -> Fix:
        """The fix of a scan, judged by all scans so far."""
        if fix.verdict == "no pose":
            return fix
        probability_by_scan = float(
            np.clip(fix.probability, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
        )
        # of a fix that was sought at a prediction, its own scan says nothing of rivals elsewhere
        accepted_alone_at = 0.0 if is_tracked else fix.accepted_at or 0.0
        probability = self.belief.see(
            fix.world_T_sensor, probability_by_scan, is_tracked, accepted_alone_at
        )
        most_precise = self.belief.most_precise(probability_by_scan, accepted_alone_at)
        met_precisions = [
            target_precision
            for target_precision in self.site.target_precisions
            if target_precision <= most_precise
        ]
        verdict: VerdictName = (
            "accepted" if self._target_precision in met_precisions else "rejected"
        )
        if verdict == "rejected" and not is_tracked and fix.verdict in ("near", "ambiguous"):
            # both need rival poses, which only a search of the whole map finds
            verdict = fix.verdict
        covariance = fix.covariance.copy()
        if self._drive.widens:
            # the fix may have slipped from the belief
            world_R_sensor = fix.world_T_sensor[:3, :3]
            covariance[3:, 3:] += world_R_sensor.T @ self.belief.slipped_m2() @ world_R_sensor
        return replace(
            fix,
            verdict=verdict,
            novelty=1 - probability,
            accepted_at=max(met_precisions, default=None),
            covariance=covariance,
        )
