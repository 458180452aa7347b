"""Sweeps of one stretch of path, laid out by odometry that matching has corrected.

Wheels turn less well than lasers see: each sweep is matched with those just before it, after Olson,
Real-Time Correlative Scan Matching, ICRA 2009.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.level.field import REACH_M
from pipeline.level.refinement import refine_in

THINNED_M = 0.1
"""Of hits in one square of this side one is searched for."""
OVER_M = 5.0
"""Metres of path over which sweeps are gathered."""
MOVED_M = 0.2
MOVED_DEG = 10.0
"""A sweep taken after less motion replaces the one before it."""
MOST_SWEEPS = 60
CELL_M = 0.1
BESIDE_M = 0.6
"""A hit is matched with hits this near."""
MATCHED_WITH = 5
"""Sweeps before it that a sweep is matched with."""
WINDOW_M = 0.3
WINDOW_DEG = 15.0
"""Odometry from sweep to sweep is searched for errors up to here."""
SIGMA_M = 0.15
LEAST_SHARE = 0.6
"""Odometry joins a sweep with those before where this share of its hits has others near; else those
before are forgotten."""
JOINS = 10
MOST_UNJOINED = 2
"""Odometry may leave so many of the last JOINS sweeps unjoined, as where wheels slip. Where it
leaves more it contradicts them: the laser is mounted otherwise than was said."""
STEP_COST = 0.15
"""What a correction of a whole window costs of the mean likelihood, so that nothing slides along a
corridor."""


@dataclass(frozen=True)
class Gathered:
    """The hits of one or several sweeps, in the frame of the newest."""

    points_m: NDArray[np.float64]
    """(n, 2) thinned."""
    newest_m: NDArray[np.float64]
    """(m, 2) thinned, of the newest sweep alone."""
    starts_m: NDArray[np.float64]
    """(b, 2) where each beam comes from."""
    ends_m: NDArray[np.float64]
    """(b, 2) where it ends."""
    path_m: float
    """Length of the path over which the sweeps were taken."""
    is_contradicted: bool = False
    """Whether odometry moves otherwise than the last sweeps do."""


@dataclass
class Gatherer:
    """Gathers the newest sweeps of a drive."""

    is_matched: bool = True
    _hits: deque[NDArray[np.float64]] = field(default_factory=lambda: deque(maxlen=MOST_SWEEPS))
    _poses: deque[NDArray[np.float64]] = field(default_factory=lambda: deque(maxlen=MOST_SWEEPS))
    """start_T_sweep (3, 3) of each."""
    _unjoined: deque[bool] = field(default_factory=lambda: deque(maxlen=JOINS))
    """Of the last sweeps that were matched, those that odometry does not join with others."""

    def add(self, points_m: NDArray[np.float64], step: NDArray[np.float64] | None) -> None:
        """Add the next sweep's hits (n, 2) or (n, 3); `step` (4, 4) is the odometry since the last.

        Without a step, or where it does not join the sweep with them, the earlier ones are
        forgotten.
        """
        hits = flat(points_m)
        if step is None or not np.isfinite(step).all() or not self._hits:
            self._unjoined.clear()
            self._start(hits)
            return
        previous_T_sweep = np.eye(3)
        previous_T_sweep[:2] = step[:2][:, [0, 1, 3]]
        start_T_sweep = self._poses[-1] @ previous_T_sweep
        if len(self._hits) > 1 and not _has_moved(self._poses[-2], self._poses[-1]):
            self._hits.pop()
            self._poses.pop()
        if self.is_matched:
            matched = self._matched(hits, start_T_sweep)
            self._unjoined.append(matched is None)
            if matched is None:
                self._start(hits)
                return
            start_T_sweep = matched
        self._hits.append(hits)
        self._poses.append(start_T_sweep)

    def _start(self, hits: NDArray[np.float64]) -> None:
        """Begin anew with one sweep."""
        self._hits.clear()
        self._poses.clear()
        self._hits.append(hits)
        self._poses.append(np.eye(3))

    def restart(self) -> None:
        """Forget all sweeps but the newest: the robot was carried, or its odometry is wrong."""
        while len(self._hits) > 1:
            self._hits.popleft()
            self._poses.popleft()

    def gathered(self, over_m: float) -> Gathered:
        """The hits of the last `over_m` metres of path, the newest sweep first."""
        poses = list(self._poses)[::-1]
        hits = list(self._hits)[::-1]
        sweep_T_start = np.linalg.inv(poses[0])
        ends = []
        starts = []
        path_m = 0.0
        for number, (pose, points) in enumerate(zip(poses, hits, strict=True)):
            if number:
                farther_m = float(np.linalg.norm(pose[:2, 2] - poses[number - 1][:2, 2]))
                if path_m + farther_m > over_m:
                    break
                path_m += farther_m
            sweep_T_this = sweep_T_start @ pose
            ends.append(points @ sweep_T_this[:2, :2].T + sweep_T_this[:2, 2])
            starts.append(np.broadcast_to(sweep_T_this[:2, 2], points.shape))
        ends_m = np.concatenate(ends)
        return Gathered(
            thinned(ends_m),
            thinned(hits[0]),
            np.concatenate(starts),
            ends_m,
            path_m,
            sum(self._unjoined) > MOST_UNJOINED,
        )

    def _matched(
        self, hits: NDArray[np.float64], start_T_sweep: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """The pose (3, 3) of a sweep, corrected by the sweeps before it; None if it fits nowhere.

        Where there is too little to match, it is that of the odometry.
        """
        beside = [
            points @ pose[:2, :2].T + pose[:2, 2]
            for points, pose in zip(
                list(self._hits)[-MATCHED_WITH:], list(self._poses)[-MATCHED_WITH:], strict=True
            )
        ]
        beside_m = thinned(np.concatenate(beside))
        if len(hits) < 3 or len(beside_m) < 3:
            return start_T_sweep
        lowest_m = beside_m.min(axis=0) - 2 * BESIDE_M
        cols, rows = (np.ceil((np.ptp(beside_m, axis=0) + 4 * BESIDE_M) / CELL_M) + 2).astype(int)
        distance_m = _stamped(beside_m - lowest_m, int(rows), int(cols))
        guess = np.array(
            [
                *(start_T_sweep[:2, 2] - lowest_m),
                np.arctan2(start_T_sweep[1, 0], start_T_sweep[0, 0]),
            ]
        )
        chosen = thinned(hits)
        pose = _around(distance_m, chosen, guess)
        refine_in(distance_m, CELL_M, chosen, pose, np.array([SIGMA_M, SIGMA_M / 2]), BESIDE_M)
        if _near_share(distance_m, chosen, pose) < LEAST_SHARE:
            return None
        cos = np.cos(pose[2])
        sin = np.sin(pose[2])
        x_m, y_m = pose[:2] + lowest_m
        return np.array([[cos, -sin, x_m], [sin, cos, y_m], [0.0, 0.0, 1.0]])


def single(points_m: NDArray[np.floating]) -> Gathered:
    """The hits (n, 2) or (n, 3) of a single sweep."""
    gatherer = Gatherer()
    gatherer.add(np.asarray(points_m, np.float64), None)
    return gatherer.gathered(0.0)


def flat(points_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """The hits (n, 2) that are finite and within REACH_M."""
    points_m = np.asarray(points_m, np.float64)[:, :2]
    near: NDArray[np.bool_] = np.all(np.isfinite(points_m), axis=1)
    near[near] = np.linalg.norm(points_m[near], axis=1) <= REACH_M
    return np.ascontiguousarray(points_m[near])


def thinned(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """One of the points (n, 2) in each square of THINNED_M, along columns of squares."""
    cells = np.floor(points_m / THINNED_M).astype(np.int64)
    _, rows = np.unique(cells[:, 0] * 1_000_003 + cells[:, 1], return_index=True)
    return np.ascontiguousarray(points_m[rows])


def _has_moved(start_T_a: NDArray[np.float64], start_T_b: NDArray[np.float64]) -> bool:
    a_T_b = np.linalg.inv(start_T_a) @ start_T_b
    turn_deg = abs(np.rad2deg(np.arctan2(a_T_b[1, 0], a_T_b[0, 0])))
    return bool(np.linalg.norm(a_T_b[:2, 2]) >= MOVED_M or turn_deg >= MOVED_DEG)


@njit(cache=True, nogil=True)
def _stamped(points_m, rows, cols):  # type: ignore[no-untyped-def]
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
def _around(distance_m, points_m, guess):  # type: ignore[no-untyped-def]
    """The likeliest pose (3,) within the window around a guess (3,)."""
    rows, cols = distance_m.shape
    best = guess.copy()
    best_score = -1.0
    steps = round(WINDOW_M / CELL_M)
    turns = int(WINDOW_DEG)
    for turn in range(-turns, turns + 1):
        heading = guess[2] + np.deg2rad(turn)
        cos = np.cos(heading)
        sin = np.sin(heading)
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
                share = (turn / turns) ** 2 + (up**2 + along**2) / steps**2
                score = total / len(xs) - STEP_COST * share
                if score > best_score:
                    best_score = score
                    best[0] = guess[0] + along * CELL_M
                    best[1] = guess[1] + up * CELL_M
                    best[2] = heading
    return best


@njit(cache=True, nogil=True)
def _near_share(distance_m, points_m, pose):  # type: ignore[no-untyped-def]
    """The share of points (n, 2) that have another within two deviations, in a pose (3,)."""
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
