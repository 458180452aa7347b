"""Localising along a path: global fixes until one is believed, then registration from the predicted pose, and back when lost."""

from dataclasses import replace
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.online.site import Fix, Site, finite
from pipeline.paths.belief import Belief
from pipeline.posing.fix import Fix as Registered

PATIENCE = 3
"""Scans in a row that may fail to be tracked before the robot is lost."""
STILL = np.eye(4)


class Tracker:
    """Follows a robot through a site; each fix is accepted by all that was seen so far, with the site's own thresholds."""

    def __init__(self, site: Site, promise: float = 0.99) -> None:
        self.site, self._promise = site, promise
        self.belief = Belief(float(site.about["verdict"]["unseen_share"]))
        self.mode: Literal["lost", "tracking"] = "lost"
        self._pose: NDArray[np.float64] | None = None
        self._step, self._misses = STILL, 0
        self._step_s: float | None = None
        self._stamp_ns: int | None = None

    def localize(
        self, points_m: NDArray[np.floating], step: NDArray[np.float64] | None = None, stamp_ns: int | None = None
    ) -> Fix:
        """The fix of the next scan (n, 3); `step` (4, 4) is its pose in the last scan's frame by odometry.

        Without odometry the robot is taken to move on as between its last two fixes, for as long as the stamps say, if they do.
        """
        start = perf_counter()
        points_m = finite(points_m)
        took_s = None if stamp_ns is None or self._stamp_ns is None else (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        guessed = step is None or not np.isfinite(step).all()
        step = self._onwards(took_s) if step is None or guessed else step
        self.belief.move(step, guessed)
        guess = None if self._pose is None else self._pose @ step
        found, tracked = self._find(points_m, guess)
        fix = self._judge(found, tracked)
        if fix.verdict == "accepted":
            self._step = step if self._pose is None else np.linalg.inv(self._pose) @ fix.world_T_sensor
            self._step_s = took_s
            self._pose, self._misses, self.mode = fix.world_T_sensor, 0, "tracking"
        elif guess is not None:
            self._misses += 1
            self._pose = guess if self._misses < PATIENCE else None
            self.mode = "lost" if self._pose is None else "tracking"
        return replace(fix, ms=1e3 * (perf_counter() - start))

    def _onwards(self, took_s: float | None) -> NDArray[np.float64]:
        """The last step between two fixes, as far and as much turned as fits the time."""
        share = took_s / self._step_s if took_s and self._step_s else 1.0
        step = self._step.copy()
        step[:3, 3] *= share
        step[:3, :3] = Rotation.from_rotvec(share * Rotation.from_matrix(step[:3, :3]).as_rotvec()).as_matrix()
        return step

    def _find(self, points_m: NDArray[np.float64], guess: NDArray[np.float64] | None) -> tuple[Registered, bool]:
        """Hypotheses, and whether they were found from the predicted pose alone."""
        if guess is not None:
            found = self.site.fixer.track(points_m, self.site.targets, guess)
            if found.hypotheses or self._misses + 1 < PATIENCE:
                return found, True
        return self._everywhere(points_m), False

    def _everywhere(self, points_m: NDArray[np.float64]) -> Registered:
        return self.site.register(points_m, self.site.rank(points_m).xy_m[0].astype(np.float64))

    def _judge(self, found: Registered, tracked: bool) -> Fix:
        """Whether to believe the best hypothesis, given all before."""
        fix = self.site.judge(found, self._promise)
        if fix.verdict == "no pose":
            return fix
        chance = float(np.clip(1 - fix.novelty, 1e-6, 1 - 1e-6))
        believed = self.belief.see(fix.world_T_sensor, chance, tracked)
        kept = [promise for promise, reject_from in self.site.promises.items() if reject_from > 0 and believed >= promise]
        verdict: Literal["accepted", "rejected"] = "accepted" if self._promise in kept else "rejected"
        return replace(fix, verdict=verdict, novelty=1 - believed, promised_precision=max(kept, default=None))
