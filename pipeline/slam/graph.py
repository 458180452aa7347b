"""The graph of a drive: odometry joins its keys, loops close it, the ground keeps it level."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn, interpolate
from pipeline.core.settings import Positive, check
from pipeline.paths.graph import imported_gtsam
from pipeline.readers.log import lifted
from pipeline.slam.keys import Keys
from pipeline.slam.loops import Loop

OVERRULED = 0.1
"""A loop whose robust weight falls below this has no say."""


@dataclass(frozen=True)
class Solution:
    """The poses of k keys, and how the loops agree with them."""

    world_T_key: Poses
    """(k, 4, 4); NaN of keys that nothing joins with the longest part."""
    residual_m: NDArray[np.float64]
    """(loop,) how far each loop's pose lies from the result; NaN of one that is not in it."""
    residual_deg: NDArray[np.float64]
    used: NDArray[np.bool_]
    """(loop,) False of one that the others overrule."""


@dataclass(frozen=True)
class DriveGraph:
    """Optimises all poses at once (gtsam; Dellaert and Kaess 2017)."""

    step: Positive = 0.01
    step_m: Positive = 0.05
    """Standard deviation of a step: this share of its length, and so much besides."""
    turn_deg_per_m: Positive = 0.05
    turn_deg: Positive = 0.2
    tilt: Positive = 0.15
    """Roll and pitch are surer than the heading, for all of the ground is seen: of its deviation
    they have this share."""
    by_log: Positive = 5.0
    """A step that is the log's own odometry has so many times these deviations."""
    loop_m: Positive = 0.1
    loop_deg: Positive = 0.5
    """Added to a loop's own covariance."""
    outlier: Positive = 2.0
    """From so many standard deviations on a loop loses its weight (Cauchy)."""
    level_deg: Positive = 3.0
    """The ground around the vehicle is level within this, since hills are there too."""
    level_m: Positive = 50.0
    """And says so once in so much path, for a hill is long."""

    def __post_init__(self) -> None:
        check(self, "graph")

    def solve(
        self,
        keys: Keys,
        loops: list[Loop],
        by_log: NDArray[np.bool_],
        up: NDArray[np.float64],
        fixed: list[tuple[int, Poses, NDArray[np.float64]]] | None = None,
    ) -> Solution:
        """Optimise the longest connected part of a drive.

        `by_log` (k,): the step to a key is the log's odometry; `up` (k, 3): the ground's normal in
        each key's frame. With `fixed`, keys with a pose (4, 4) in a map and its covariance (6, 6),
        the poses are in that map, and parts that none of them joins have none.
        """
        gtsam = imported_gtsam()
        part_of = self._connected(keys, loops, fixed)
        members = np.flatnonzero(part_of)
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        start = self._start(keys, loops, members, fixed)
        for key in members.tolist():
            values.insert(key, gtsam.Pose3(start[key]))
        for key in members[1:].tolist():
            if part_of[key - 1] and keys.parts[key - 1] == keys.parts[key]:
                self._add_step(gtsam, graph, keys, key, float(by_log[key]))
        self._add_level(gtsam, graph, keys, members, up)
        robust = gtsam.noiseModel.mEstimator.Cauchy.Create(self.outlier)
        for loop in loops:
            if part_of[loop.key] and part_of[loop.later]:
                noise = gtsam.noiseModel.Robust.Create(robust, self._noise(gtsam, loop.covariance))
                pose = gtsam.Pose3(loop.key_T_later)
                graph.add(gtsam.BetweenFactorPose3(loop.key, loop.later, pose, noise))
        for key, world_T_key, covariance in fixed or ():
            noise = gtsam.noiseModel.Robust.Create(robust, self._noise(gtsam, covariance))
            graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(world_T_key), noise))
        if not fixed:
            first = int(members[0])
            sds = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.1, 1e-4, 1e-4, 1e-4, 1e-4]))
            graph.add(gtsam.PriorFactorPose3(first, gtsam.Pose3(start[first]), sds))
        result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        world_T_key = np.full((len(keys.rows), 4, 4), np.nan)
        for key in members.tolist():
            world_T_key[key] = result.atPose3(key).matrix()
        return self._solution(world_T_key, loops)

    def _add_step(self, gtsam: Any, graph: Any, keys: Keys, key: int, by_log: float) -> None:
        step = np.linalg.inv(keys.odom_T_key[key - 1]) @ keys.odom_T_key[key]
        length_m = float(np.linalg.norm(step[:3, 3]))
        turn = np.deg2rad(self.turn_deg_per_m * length_m + self.turn_deg)
        away_m = self.step * length_m + self.step_m
        sds = np.array([self.tilt * turn, self.tilt * turn, turn, away_m, away_m, away_m])
        sds *= self.by_log if by_log else 1.0
        graph.add(
            gtsam.BetweenFactorPose3(
                key - 1, key, gtsam.Pose3(step), gtsam.noiseModel.Diagonal.Sigmas(sds)
            )
        )

    def _add_level(
        self,
        gtsam: Any,
        graph: Any,
        keys: Keys,
        members: NDArray[np.int64],
        up: NDArray[np.float64],
    ) -> None:
        noise = gtsam.noiseModel.Isotropic.Sigma(2, np.deg2rad(self.level_deg))
        last_m = -np.inf
        for key in members.tolist():
            if keys.path_m[key] - last_m >= self.level_m and np.isfinite(up[key]).all():
                last_m = float(keys.path_m[key])
                graph.add(
                    gtsam.AttitudeFactorPose3(
                        key, gtsam.Unit3(0.0, 0.0, 1.0), noise, gtsam.Unit3(*up[key])
                    )
                )

    def _noise(self, gtsam: Any, covariance: NDArray[np.float64]) -> Any:
        floor = np.diag(np.repeat([np.deg2rad(self.loop_deg), self.loop_m], 3) ** 2)
        return gtsam.noiseModel.Gaussian.Covariance(covariance + floor)

    def _connected(
        self,
        keys: Keys,
        loops: list[Loop],
        fixed: list[tuple[int, Poses, NDArray[np.float64]]] | None,
    ) -> NDArray[np.bool_]:
        """Which keys (k,) are in the longest set of parts that loops join, or in those fixed."""
        joined = keys.parts.copy()
        for loop in loops:
            joined[joined == joined[loop.later]] = joined[loop.key]
        if fixed is not None:
            fixed_parts = {int(joined[key]) for key, _, _ in fixed}
            return np.isin(joined, sorted(fixed_parts))
        counts = np.bincount(joined)
        return np.asarray(joined == counts.argmax())

    def _start(
        self,
        keys: Keys,
        loops: list[Loop],
        members: NDArray[np.int64],
        fixed: list[tuple[int, Poses, NDArray[np.float64]]] | None,
    ) -> Poses:
        """First guesses (k, 4, 4): each part by its odometry, laid by a loop or a fixed key."""
        start = keys.odom_T_key.copy()
        placed: set[int] = set()
        for key, world_T_key, _ in fixed or ():
            part = int(keys.parts[key])
            if part not in placed:
                rows = keys.parts == part
                start[rows] = (
                    world_T_key @ np.linalg.inv(keys.odom_T_key[key]) @ keys.odom_T_key[rows]
                )
                placed.add(part)
        if not placed:
            placed.add(int(keys.parts[members[0]]))
        for _ in range(len(loops)):
            for loop in loops:
                for a, b, a_T_b in (
                    (loop.key, loop.later, loop.key_T_later),
                    (loop.later, loop.key, np.linalg.inv(loop.key_T_later)),
                ):
                    if int(keys.parts[a]) in placed and int(keys.parts[b]) not in placed:
                        rows = keys.parts == keys.parts[b]
                        start[rows] = (
                            start[a]
                            @ a_T_b
                            @ np.linalg.inv(keys.odom_T_key[b])
                            @ keys.odom_T_key[rows]
                        )
                        placed.add(int(keys.parts[b]))
            if set(keys.parts[members].tolist()) <= placed:
                break
        return start

    def _solution(self, world_T_key: Poses, loops: list[Loop]) -> Solution:
        residual_m = np.full(len(loops), np.nan)
        residual_deg = np.full(len(loops), np.nan)
        used = np.zeros(len(loops), bool)
        for number, loop in enumerate(loops):
            later = world_T_key[loop.key] @ loop.key_T_later
            if not np.isfinite([later, world_T_key[loop.later]]).all():
                continue
            away_m, turn_deg = distance_and_turn(later[None], world_T_key[loop.later][None])
            residual_m[number] = away_m[0]
            residual_deg[number] = turn_deg[0]
            sd_m = np.sqrt(np.trace(loop.covariance[3:, 3:]) / 3 + self.loop_m**2)
            sd_deg = np.hypot(
                np.rad2deg(np.sqrt(np.trace(loop.covariance[:3, :3]) / 3)), self.loop_deg
            )
            square = (away_m[0] / sd_m) ** 2 + (turn_deg[0] / sd_deg) ** 2
            used[number] = 1 / (1 + square / self.outlier**2) >= OVERRULED
        return Solution(world_T_key, residual_m, residual_deg, used)


def spread_over_scans(keys: Keys, world_T_key: Poses, odom_T_scan: Poses) -> Poses:
    """The poses (n, 4, 4) of all scans of a log, in its own frame, from those of its keys.

    What the graph moves two neighbouring keys by is interpolated between them; scans of parts
    without a pose have none. `odom_T_scan` (n, 4, 4) are the track's, of the log's own frame.
    """
    odom_T_raised = lifted(odom_T_scan, keys.lift_m)
    world_T_odom = world_T_key @ np.linalg.inv(keys.odom_T_key)
    scans = np.arange(len(odom_T_scan))
    before = np.searchsorted(keys.rows, scans, side="right") - 1
    before = before.clip(0)
    after = (before + 1).clip(max=len(keys.rows) - 1)
    same_part = keys.parts[before] == keys.parts[after]
    between = (keys.rows[after] - keys.rows[before]).clip(1)
    share = np.where(same_part, (scans - keys.rows[before]) / between, 0.0).clip(0.0, 1.0)
    world_T_scan = np.full_like(odom_T_scan, np.nan)
    known = np.isfinite(odom_T_raised).all((1, 2)) & np.isfinite(world_T_odom[before]).all((1, 2))
    to = np.where(same_part, after, before)
    moves = interpolate(world_T_odom[before[known]], world_T_odom[to[known]], share[known])
    world_T_scan[known] = lifted(moves @ odom_T_raised[known], -keys.lift_m)
    return world_T_scan
