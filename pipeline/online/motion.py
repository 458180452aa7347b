"""How a robot moves from scan to scan: by its odometry, or by a prediction (METHODS 10.3).

A `Drive` is what a `Tracker` remembers of a robot's path besides its belief: `ScanDrive` for 3-D
scans, `SweepDrive` in level_site.py for level sweeps. `Motion` predicts the steps of a robot
without odometry.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import distance_and_turn
from pipeline.paths.belief import NEW_VIEW_M

SHORTEST_S = 0.02
LONGEST_S = 5.0
"""Two fixes give the robot's speed if between SHORTEST_S and LONGEST_S seconds lie between them.
After more than LONGEST_S a robot without odometry may be anywhere. Scans without stamps count as
one second apart."""
FASTEST_M_S = 40.0
FASTEST_DEG_S = 180.0
"""No robot moves or turns faster."""
STANDING_M = 0.5
"""How far a step of odometry may exceed FASTEST_M_S, since stamps are not exact."""
ACCELERATIONS = np.array([2.0, 15.0])
"""Standard deviations of a robot's acceleration in m/s² and °/s², until fixes have shown them."""
UNKNOWN_SPEEDS = np.array([FASTEST_M_S, FASTEST_DEG_S]) / 3
"""Standard deviations of the speed of a robot, in m/s and °/s, while it is unknown: a third of the
fastest speeds."""


class Motion:
    """Predicts the motion of a robot without odometry from the speed between its last two fixes."""

    def __init__(self) -> None:
        self._last_fix: tuple[NDArray[np.float64], float] | None = None  # its pose and its time
        self._since_fix_s = 0.0
        # from the last two fixes that gave a speed
        self._speed_m_s = np.zeros(3)  # in the robot's frame
        self._turn_rad_s = np.zeros(3)  # a rotation vector
        self._fix_interval_s = 0.0  # between these fixes; 0 while the speed is unknown
        # the accelerations since then: their sums of squares in m/s² and °/s², and their number;
        # ACCELERATIONS count as the first
        self._acceleration_squares = ACCELERATIONS**2
        self._acceleration_count = 1

    def predict(self, took_s: float) -> NDArray[np.float64]:
        """The step (4, 4) that the robot makes in `took_s` seconds at the speed of the last fixes.

        If the clock jumped back or far ahead, the time between the last two fixes that gave a speed
        is used instead. Without such fixes the robot is predicted to stand still.
        """
        seconds = self._plausible_s(took_s)
        step = np.eye(4)
        step[:3, 3] = seconds * self._speed_m_s
        step[:3, :3] = Rotation.from_rotvec(seconds * self._turn_rad_s).as_matrix()
        return step

    def deviations(self, took_s: float) -> tuple[float, float]:
        """The standard deviations of the step predicted for `took_s`, in metres and degrees.

        If the robot accelerates by a, the prediction is off by ½ a t² at t seconds after the last
        fix. So the share of one step is ½ a (t₁² − t₀²), with t₀ and t₁ before and after it.
        """
        if not self._fix_interval_s:
            away_m, turn_deg = UNKNOWN_SPEEDS * max(self._plausible_s(took_s), SHORTEST_S)
            return float(away_m), float(turn_deg)
        hidden_step = np.zeros(2)
        if self._plausible_s(took_s) < SHORTEST_S:
            # it may be the same scan twice, or the clock stands still while the robot moves on
            turn_deg_s = np.rad2deg(np.linalg.norm(self._turn_rad_s))
            speeds = np.array([np.linalg.norm(self._speed_m_s), turn_deg_s])
            hidden_step = self._fix_interval_s * speeds
        before_s = self._since_fix_s
        after_s = before_s + self._counted_s(took_s)
        acceleration = np.sqrt(self._acceleration_squares / self._acceleration_count)
        away_m, turn_deg = hidden_step + acceleration / 2 * (after_s**2 - before_s**2)
        return float(away_m), float(turn_deg)

    def advance(self, took_s: float) -> None:
        """Count a predicted step of `took_s` seconds as time since the last fix."""
        self._since_fix_s += self._counted_s(took_s)

    def note_fix(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Note a likely fix (4, 4) and its time.

        If the fix before is between SHORTEST_S and LONGEST_S seconds old, both give the speed, and
        how far the prediction was off.
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
            # a = 2 d / t², as `deviations` has it
            off_m, off_deg = distance_and_turn(self.predict(seconds)[None], step[None])
            acceleration = 2 * np.array([off_m[0], off_deg[0]]) / seconds**2
            self._acceleration_squares = self._acceleration_squares + acceleration**2
            self._acceleration_count += 1
        self._speed_m_s = speed_m_s
        self._turn_rad_s = turn_rad_s
        self._fix_interval_s = seconds

    def _plausible_s(self, took_s: float) -> float:
        """The time of a step; if it is negative or too long, the time between the last two fixes
        that gave a speed, or 0 without such fixes."""
        return took_s if 0 <= took_s <= LONGEST_S else self._fix_interval_s

    def _counted_s(self, took_s: float) -> float:
        """The time that counts for a step's deviation; if it is too short, the time between the
        last two fixes that gave a speed."""
        seconds = self._plausible_s(took_s)
        return self._fix_interval_s if seconds < SHORTEST_S else seconds


class Step(NamedTuple):
    """The step of a robot from the last scan to the next."""

    before_T_now: NDArray[np.float64]
    """(4, 4) the pose at the next scan in the frame of the last scan."""
    deviations: tuple[float, float] | None = None
    """Standard deviations of a predicted step in metres and degrees; None for odometry."""
    is_anywhere: bool = False
    """Whether the robot may have gone anywhere before this step, so that its pose is forgotten."""


class Drive(Protocol):
    """What a tracker remembers of the path besides its belief, by the kind of its site."""

    counts_no_pose: bool
    """Whether a scan without a pose counts as a scan whose fix was not accepted."""
    widens: bool
    """Whether the covariance of a fix is widened by how far the fix may have slipped from the
    belief."""
    new_view_m: float
    """How far the robot must move until its next query is a view of its own."""

    def query(self, points_m: NDArray[np.float64], step: NDArray[np.float64] | None) -> Any:
        """The query for the next scan, which is a `step` (4, 4) of odometry from the last scan."""

    def step(self, step: NDArray[np.float64] | None, took_s: float | None) -> Step:
        """The step by odometry (4, 4), or a prediction; `took_s` is None if it is unknown."""

    def note_fix(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Note a likely fix (4, 4) and its time."""

    def lose(self) -> None:
        """Note that the robot is lost."""


class ScanDrive:
    """The drive of a robot with 3-D scans, each of which is registered alone."""

    counts_no_pose = True
    widens = True
    new_view_m = NEW_VIEW_M

    def __init__(self) -> None:
        self._motion = Motion()

    def query(
        self, points_m: NDArray[np.float64], step: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """The points (n, 3) of the scan itself."""
        return points_m

    def step(self, step: NDArray[np.float64] | None, took_s: float | None) -> Step:
        """The step by odometry, or a predicted step if a robot cannot make the step by odometry.

        After more than LONGEST_S seconds without odometry the robot may be anywhere.
        """
        if step is not None and np.isfinite(step).all() and _is_driven(step, took_s):
            return Step(step)
        passed_s = 1.0 if took_s is None else took_s
        predicted = Step(
            self._motion.predict(passed_s), self._motion.deviations(passed_s), passed_s > LONGEST_S
        )
        self._motion.advance(passed_s)
        return predicted

    def note_fix(self, world_T_robot: NDArray[np.float64], time_s: float) -> None:
        """Note a likely fix (4, 4): the last two fixes predict the robot's motion."""
        self._motion.note_fix(world_T_robot, time_s)

    def lose(self) -> None:
        """Do nothing: a scan is registered without the scans before it."""


def _is_driven(step: NDArray[np.float64], took_s: float | None) -> bool:
    """Whether a robot can make a step (4, 4) in a time; True if the time is unknown."""
    if took_s is None:
        return True
    return float(np.linalg.norm(step[:3, 3])) <= FASTEST_M_S * max(took_s, 0.0) + STANDING_M
