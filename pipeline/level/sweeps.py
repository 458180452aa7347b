"""Gathers the sweeps of the last metres of path into one query (METHODS 13.2).

In: sweeps and the steps of odometry between them. Out: their hits, in the frame of the newest
sweep. Wheels measure turns less precisely than a laser. So each step is corrected: the new sweep is
matched with the five sweeps before it, in a window around its pose by odometry (Olson, Real-Time
Correlative Scan Matching, ICRA 2009), and refined. If it fits nowhere in the window, the earlier
sweeps are forgotten.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import transformed, yaw
from pipeline.level.field import REACH_M
from pipeline.level.refinement import refine_in

OVER_M = 5.0
"""Callers of `Gatherer.gathered` gather sweeps over this much path."""
MOST_SWEEPS = 60
"""Largest number of sweeps that are remembered."""
MOVED_M = 0.2
MOVED_DEG = 10.0
"""A sweep that differs by less than both of these from the sweep before it is dropped when the next
sweep arrives; the newest sweep is always remembered."""
THINNED_M = 0.1
"""Hits are thinned to one in each square of this side."""

MATCHED_SWEEPS = 5
"""Number of earlier sweeps that a sweep is matched with."""
CELL_M = 0.1
"""Side of the cells in which matching looks up distances."""
BESIDE_M = 0.6
"""A hit has no match if no earlier hit lies within this distance."""
SIGMA_M = 0.15
"""Standard deviation of the distance between matching hits."""
WINDOW_M = 0.3
WINDOW_DEG = 15.0
"""Largest correction of the step of odometry from one sweep to the next."""
TURN_STEP_DEG = 1
"""The window is searched in turns of this angle, and in steps of CELL_M."""
STEP_COST = 0.15
"""The mean likelihood that a correction as large as the window costs, so that no sweep drifts along
a corridor."""
LEAST_SHARE = 0.6
"""A sweep is joined with the earlier sweeps if, at its matched pose, at least this share of its
hits lies near theirs."""
JUDGED_SWEEPS = 10
MOST_UNJOINED = 2
"""Odometry contradicts the sweeps if more than MOST_UNJOINED of the last JUDGED_SWEEPS sweeps could
not be joined: most likely the laser is mounted otherwise than specified. Slipping wheels cause
fewer."""


@dataclass(frozen=True)
class Gathered:
    """The hits of one or several sweeps, in metres, in the frame of the newest sweep."""

    points_m: NDArray[np.float64]
    """(n, 2) the hits of all sweeps, thinned."""
    newest_m: NDArray[np.float64]
    """(m, 2) the hits of the newest sweep alone, thinned."""
    starts_m: NDArray[np.float64]
    """(b, 2) the start of each beam."""
    ends_m: NDArray[np.float64]
    """(b, 2) the end of each beam: all hits, not thinned."""
    path_m: float
    """The length of path over which the sweeps were taken."""
    is_contradicted: bool = False
    """Whether odometry contradicts the last sweeps (MOST_UNJOINED)."""


@dataclass
class Gatherer:
    """Remembers the newest sweeps of a drive, and their poses."""

    corrects_odometry: bool = True
    """Whether each step of odometry is corrected by matching."""
    matched_step: NDArray[np.float64] | None = None
    """The last step (3, 3), corrected by matching; None if its sweep was not joined."""
    _hits: deque[NDArray[np.float64]] = field(default_factory=lambda: deque(maxlen=MOST_SWEEPS))
    """The hits (n, 2) of each remembered sweep, in its own frame."""
    _poses: deque[NDArray[np.float64]] = field(default_factory=lambda: deque(maxlen=MOST_SWEEPS))
    """The pose start_T_sweep (3, 3) of each remembered sweep, in the frame of the sweep at which
    the gatherer last started."""
    _unjoined: deque[bool] = field(default_factory=lambda: deque(maxlen=JUDGED_SWEEPS))
    """For each of the last matched sweeps, whether it could not be joined with earlier sweeps."""

    def add(self, points_m: NDArray[np.float64], step: NDArray[np.float64] | None) -> None:
        """Add the hits (n, 2) or (n, 3) of the next sweep, taken a `step` (4, 4) after the last.

        The earlier sweeps are forgotten if there is no step of odometry, or if the new sweep cannot
        be joined with them.
        """
        hits = flat(points_m)
        self.matched_step = None
        if step is None or not np.isfinite(step).all() or not self._hits:
            self._unjoined.clear()
            self._start(hits)
            return
        previous_T_sweep = np.eye(3)
        previous_T_sweep[:2] = step[:2][:, [0, 1, 3]]  # the part of the step in the plane
        last_pose = self._poses[-1]
        start_T_sweep = last_pose @ previous_T_sweep
        # the last sweep was remembered as the newest; it stays only if the robot had moved
        if len(self._hits) > 1 and not _has_moved(self._poses[-2], self._poses[-1]):
            self._hits.pop()
            self._poses.pop()
        if self.corrects_odometry:
            matched_pose = self._match(hits, start_T_sweep)
            self._unjoined.append(matched_pose is None)
            if matched_pose is None:
                self._start(hits)
                return
            start_T_sweep = matched_pose
            self.matched_step = np.linalg.inv(last_pose) @ matched_pose
        self._hits.append(hits)
        self._poses.append(start_T_sweep)

    def restart(self) -> None:
        """Forget all sweeps but the newest, as after the robot was carried to another place."""
        while len(self._hits) > 1:
            self._hits.popleft()
            self._poses.popleft()

    def gathered(self, over_m: float) -> Gathered:
        """The hits of the sweeps of the last `over_m` metres of path, the newest sweep first."""
        newest_first = list(zip(self._poses, self._hits, strict=True))[::-1]
        newest_pose, newest_hits = newest_first[0]
        newest_T_start = np.linalg.inv(newest_pose)
        last_pose = newest_pose
        ends: list[NDArray[np.float64]] = []
        starts: list[NDArray[np.float64]] = []
        path_m = 0.0
        for pose, hits in newest_first:
            step_m = float(np.linalg.norm(pose[:2, 2] - last_pose[:2, 2]))
            if path_m + step_m > over_m and ends:
                break
            path_m += step_m
            last_pose = pose
            newest_T_sweep = newest_T_start @ pose
            ends.append(transformed(newest_T_sweep, hits))
            starts.append(np.broadcast_to(newest_T_sweep[:2, 2], hits.shape))
        ends_m = np.concatenate(ends)
        return Gathered(
            thinned(ends_m),
            thinned(newest_hits),
            np.concatenate(starts),
            ends_m,
            path_m,
            is_contradicted=sum(self._unjoined) > MOST_UNJOINED,
        )

    def _start(self, hits: NDArray[np.float64]) -> None:
        """Forget all sweeps, and start again with the hits (n, 2) of a new sweep."""
        self._hits.clear()
        self._poses.clear()
        self._hits.append(hits)
        self._poses.append(np.eye(3))

    def _match(
        self, hits: NDArray[np.float64], start_T_sweep: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """The pose (3, 3) of a sweep by matching, from that by odometry; None if it fits nowhere.

        If there are too few hits to match, the pose by odometry is returned.
        """
        # the hits of the earlier sweeps
        earlier_hits = list(self._hits)[-MATCHED_SWEEPS:]
        earlier_poses = list(self._poses)[-MATCHED_SWEEPS:]
        in_start_frame = [
            transformed(pose, earlier)
            for earlier, pose in zip(earlier_hits, earlier_poses, strict=True)
        ]
        earlier_m = thinned(np.concatenate(in_start_frame))
        if len(hits) < 3 or len(earlier_m) < 3:
            return start_T_sweep
        # the distance to the nearest of them, on a grid with a margin for hits of the new sweep
        corner_m = earlier_m.min(axis=0) - 2 * BESIDE_M
        sides_m = np.ptp(earlier_m, axis=0) + 4 * BESIDE_M
        cols, rows = (np.ceil(sides_m / CELL_M) + 2).astype(int)
        distance_m = _distances(earlier_m - corner_m, int(rows), int(cols))
        # find the best pose in the window, then refine it in place, first coarsely, then finely
        heading_rad = yaw(start_T_sweep)
        guess = np.array([*(start_T_sweep[:2, 2] - corner_m), heading_rad])
        thinned_hits = thinned(hits)
        pose = _best_in_window(distance_m, thinned_hits, guess)
        sigmas_m = np.array([SIGMA_M, SIGMA_M / 2])
        refine_in(distance_m, CELL_M, thinned_hits, pose, sigmas_m, BESIDE_M)
        if _near_share(distance_m, thinned_hits, pose) < LEAST_SHARE:
            return None
        cos = np.cos(pose[2])
        sin = np.sin(pose[2])
        x_m, y_m = pose[:2] + corner_m
        return np.array([[cos, -sin, x_m], [sin, cos, y_m], [0.0, 0.0, 1.0]])


def single(points_m: NDArray[np.floating]) -> Gathered:
    """The hits (n, 2) or (n, 3) of a single sweep, gathered as a query."""
    gatherer = Gatherer()
    gatherer.add(np.asarray(points_m, np.float64), None)
    return gatherer.gathered(0.0)


def flat(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The x and y (n, 2) of the hits (m, 2 or 3) that are finite and within REACH_M."""
    points_m = np.asarray(points_m, np.float64)[:, :2]
    near: NDArray[np.bool_] = np.all(np.isfinite(points_m), axis=1)
    near[near] = np.linalg.norm(points_m[near], axis=1) <= REACH_M
    return np.ascontiguousarray(points_m[near])


def thinned(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points (n, 2) thinned to the first in each square of THINNED_M, sorted by square."""
    squares = np.floor(points_m / THINNED_M).astype(np.int64)
    square_numbers = squares[:, 0] * 1_000_003 + squares[:, 1]  # one number for each square
    _, rows = np.unique(square_numbers, return_index=True)
    return np.ascontiguousarray(points_m[rows])


def _has_moved(start_T_before: NDArray[np.float64], start_T_after: NDArray[np.float64]) -> bool:
    """Whether the motion between two poses (3, 3) makes the later sweep worth keeping."""
    motion = np.linalg.inv(start_T_before) @ start_T_after
    turn_deg = abs(np.rad2deg(yaw(motion)))
    return bool(np.linalg.norm(motion[:2, 2]) >= MOVED_M or turn_deg >= MOVED_DEG)


@njit(cache=True, nogil=True)
def _distances(points_m, rows, cols):  # type: ignore[no-untyped-def]
    """(row, col) distance from the centre of each cell to the nearest point, at most BESIDE_M."""
    distance_m = np.full((rows, cols), BESIDE_M, np.float32)
    reach = int(np.ceil(BESIDE_M / CELL_M))
    for point in range(len(points_m)):
        x = points_m[point, 0] / CELL_M
        y = points_m[point, 1] / CELL_M
        for row in range(max(0, int(y) - reach), min(rows, int(y) + reach + 1)):
            for col in range(max(0, int(x) - reach), min(cols, int(x) + reach + 1)):
                away_m = CELL_M * np.hypot(row + 0.5 - y, col + 0.5 - x)
                if away_m < distance_m[row, col]:
                    distance_m[row, col] = away_m
    return distance_m


@njit(cache=True, nogil=True)
def _best_in_window(distance_m, points_m, guess):  # type: ignore[no-untyped-def]
    """The best pose (3,) of points (n, 2) in the window around a guess (3,).

    The best pose has the highest mean likelihood minus the cost of its distance from the guess.
    Poses are x, y in metres from the corner of the cells (row, col) and heading in radians.
    """
    rows, cols = distance_m.shape
    best = guess.copy()
    best_score = -1.0
    steps = round(WINDOW_M / CELL_M)
    turns = int(WINDOW_DEG) // TURN_STEP_DEG
    for turn in range(-turns, turns + 1):
        heading = guess[2] + np.deg2rad(turn * TURN_STEP_DEG)
        cos = np.cos(heading)
        sin = np.sin(heading)
        # positions in cells, so that a step of the window moves all points by a whole cell
        xs = (guess[0] + cos * points_m[:, 0] - sin * points_m[:, 1]) / CELL_M
        ys = (guess[1] + sin * points_m[:, 0] + cos * points_m[:, 1]) / CELL_M
        for up in range(-steps, steps + 1):
            for along in range(-steps, steps + 1):
                total = 0.0
                for point in range(len(xs)):
                    row = int(ys[point] + up)
                    col = int(xs[point] + along)
                    if 0 <= row < rows and 0 <= col < cols:
                        away_m = distance_m[row, col]
                        if away_m < BESIDE_M:
                            total += np.exp(-(away_m**2) / (2 * SIGMA_M**2))
                correction = (turn / turns) ** 2 + (up**2 + along**2) / steps**2
                score = total / len(xs) - STEP_COST * correction
                if score > best_score:
                    best_score = score
                    best[0] = guess[0] + along * CELL_M
                    best[1] = guess[1] + up * CELL_M
                    best[2] = heading
    return best


@njit(cache=True, nogil=True)
def _near_share(distance_m, points_m, pose):  # type: ignore[no-untyped-def]
    """The share of points (n, 2), at a pose (3,), that lie within 2 SIGMA_M of an earlier hit."""
    rows, cols = distance_m.shape
    cos = np.cos(pose[2])
    sin = np.sin(pose[2])
    near = 0
    for point in range(len(points_m)):
        x = (pose[0] + cos * points_m[point, 0] - sin * points_m[point, 1]) / CELL_M
        y = (pose[1] + sin * points_m[point, 0] + cos * points_m[point, 1]) / CELL_M
        if 0 <= x < cols and 0 <= y < rows and distance_m[int(y), int(x)] < 2 * SIGMA_M:
            near += 1
    return near / len(points_m)
