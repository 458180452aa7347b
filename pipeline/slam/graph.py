"""The graph of a drive: the poses of its keys that fit odometry, loops and the ground best.

In: keys (keys.py) and loops (loops.py). Out: a `Solution`, a pose in the world for each key
(METHODS 12.3). `spread_over_scans` then carries these poses over to all scans of the drive.

1. Find the keys that odometry and loops connect with a fix on a map or, without fixes, the largest
   set of connected keys.
2. Guess their poses: by odometry within a part of the drive, and by a loop from part to part.
3. Add a factor for each step of odometry, each loop and each fix, and for the ground at intervals.
4. Optimise all poses at once (pipeline/paths/pose_graph.py).
5. Compare the loops with the result: loops that contradict it are overruled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, distance_and_turn, interpolate
from pipeline.core.settings import Positive, checked
from pipeline.paths.pose_graph import PoseGraph
from pipeline.readers.log import lifted
from pipeline.slam.keys import Keys
from pipeline.slam.loops import Loop

OVERRULED_WEIGHT = 0.1
"""A loop is overruled if its weight in Cauchy's robust loss falls below this."""
FIRST_SDS = np.array([0.1, 0.1, 1e-4, 1e-4, 1e-4, 1e-4])
"""Without a map the first key has a prior at its pose by odometry, with these standard deviations
of roll, pitch, yaw in radians and x, y, z in metres: only the ground may tilt it."""


@dataclass(frozen=True)
class KeyFix:
    """A key of a drive that was located on a map, and its pose there."""

    key: int
    world_T_key: Poses
    """(4, 4) the pose of the key's frame, whose ground is at z = 0, in the map's world."""
    covariance: NDArray[np.float64]
    """(6, 6) of a small turn in radians, then a step in metres, in the key's frame."""


@dataclass(frozen=True)
class Solution:
    """The poses of k keys, and how the loops agree with them."""

    world_T_key: Poses
    """(k, 4, 4) poses; NaN for a key that is connected neither with the longest part nor with the
    map."""
    residual_m: NDArray[np.float64]
    """(loop,) distance between each loop's pose and the result; NaN for a loop whose keys have no
    pose."""
    residual_deg: NDArray[np.float64]
    """(loop,) turn between each loop's pose and the result; NaN for the same loops."""
    used: NDArray[np.bool_]
    """(loop,) False for a loop that the result overrules."""


@dataclass(frozen=True)
@checked("graph")
class DriveGraph:
    """Optimises the poses of all keys at once, by the deviations of odometry, loops and ground.

    Deviations are standard deviations (conf/slam.yaml).
    """

    step: Positive = 0.01
    step_m: Positive = 0.05
    """Deviation of the position after a step: this share of the step's length, plus `step_m`."""
    turn_deg_per_m: Positive = 0.05
    turn_deg: Positive = 0.2
    """Deviation of the heading after a step: `turn_deg_per_m` times the step's length, plus
    `turn_deg`."""
    tilt: Positive = 0.15
    """Deviation of roll and pitch, as a share of the heading's: the ground all around makes them
    more certain."""
    by_log: Positive = 5.0
    """Factor of the deviations of a step that is the log's odometry."""
    loop_m: Positive = 0.1
    loop_deg: Positive = 0.5
    """Deviations of a loop or a fix, added to its own covariance."""
    outlier: Positive = 2.0
    """A loop or a fix that is off by more deviations than this loses weight (Cauchy's loss)."""
    level_deg: Positive = 3.0
    """Deviation of the ground around the vehicle from level, since there are hills."""
    level_m: Positive = 50.0
    """Path between two factors for level ground, since a hill is long."""

    def solve(
        self,
        keys: Keys,
        loops: list[Loop],
        by_log: NDArray[np.bool_],
        ground_normals: NDArray[np.float64],
        fixes: Sequence[KeyFix] = (),
    ) -> Solution:
        """Optimise the largest set of keys that loops connect, or the keys connected with fixes.

        `by_log` (k,) is True where the step to a key is the log's odometry; `ground_normals` (k, 3)
        is the ground's normal in each key's frame, NaN where unknown. With fixes the poses are in
        the world of their map, and parts of the drive without a fix have no poses.
        """
        is_member = _connected(keys, loops, fixes)
        members = np.flatnonzero(is_member)
        start = _start(keys, loops, members, fixes)
        graph = PoseGraph(members, start[members])
        self._add_steps(graph, keys, is_member, by_log)
        self._add_ground(graph, keys, members, ground_normals)
        for loop in loops:
            if is_member[loop.key] and is_member[loop.later]:
                graph.join(loop.key, loop.later, loop.key_T_later, self._noise(graph, loop))
        for fix in fixes:
            graph.hold(fix.key, fix.world_T_key, self._noise(graph, fix))
        if not fixes:
            graph.hold(int(members[0]), start[members[0]], graph.deviations(FIRST_SDS))

        world_T_key = np.full((len(keys.rows), 4, 4), np.nan)
        world_T_key[members] = graph.solved()
        return self._solution(world_T_key, loops)

    def _add_steps(
        self,
        graph: PoseGraph,
        keys: Keys,
        is_member: NDArray[np.bool_],
        by_log: NDArray[np.bool_],
    ) -> None:
        """Add odometry: a factor between each key and the one before it in the same part."""
        for key in range(1, len(keys.rows)):
            if not (is_member[key - 1] and is_member[key]):
                continue
            if keys.parts[key - 1] != keys.parts[key]:
                continue
            step = np.linalg.inv(keys.odom_T_key[key - 1]) @ keys.odom_T_key[key]
            length_m = float(np.linalg.norm(step[:3, 3]))
            turn = np.deg2rad(self.turn_deg_per_m * length_m + self.turn_deg)
            away_m = self.step * length_m + self.step_m
            sds = np.array([self.tilt * turn, self.tilt * turn, turn, away_m, away_m, away_m])
            if by_log[key]:
                sds *= self.by_log
            graph.join(key - 1, key, step, graph.deviations(sds))

    def _add_ground(
        self,
        graph: PoseGraph,
        keys: Keys,
        members: NDArray[np.int64],
        ground_normals: NDArray[np.float64],
    ) -> None:
        """Add that the ground is level: a factor for one key in every `level_m` of path."""
        last_m = -np.inf
        for key in members.tolist():
            is_known = np.isfinite(ground_normals[key]).all()
            if is_known and keys.path_m[key] - last_m >= self.level_m:
                last_m = float(keys.path_m[key])
                graph.level(key, ground_normals[key], self.level_deg)

    def _noise(self, graph: PoseGraph, constraint: Loop | KeyFix) -> Any:
        """The noise model of a loop or a fix."""
        return graph.robust(constraint.covariance, self.loop_deg, self.loop_m, self.outlier)

    def _solution(self, world_T_key: Poses, loops: list[Loop]) -> Solution:
        """Compare the loops with the optimised poses (k, 4, 4)."""
        residual_m = np.full(len(loops), np.nan)
        residual_deg = np.full(len(loops), np.nan)
        used = np.zeros(len(loops), bool)
        for number, loop in enumerate(loops):
            # how many deviations the loop is off, and its weight by Cauchy's loss
            by_loop = world_T_key[loop.key] @ loop.key_T_later
            by_graph = world_T_key[loop.later]
            if not np.isfinite([by_loop, by_graph]).all():
                continue
            away_m, turn_deg = distance_and_turn(by_loop, by_graph)
            residual_m[number] = away_m
            residual_deg[number] = turn_deg
            sd_m = np.sqrt(np.trace(loop.covariance[3:, 3:]) / 3 + self.loop_m**2)
            sd_rad = np.sqrt(np.trace(loop.covariance[:3, :3]) / 3)
            sd_deg = np.hypot(np.rad2deg(sd_rad), self.loop_deg)
            square = (away_m / sd_m) ** 2 + (turn_deg / sd_deg) ** 2
            cauchy_weight = 1 / (1 + square / self.outlier**2)
            used[number] = cauchy_weight >= OVERRULED_WEIGHT
        return Solution(world_T_key, residual_m, residual_deg, used)


def spread_over_scans(keys: Keys, world_T_key: Poses, odom_T_scan: Poses) -> Poses:
    """The poses (n, 4, 4) of all scans of a log, from those of its keys.

    Between two keys, the correction of the odometry by the graph is interpolated by the number of
    the scan. A scan has no pose (NaN) if its part has none. `odom_T_scan` (n, 4, 4) is the track's;
    it and the result are poses of the log's own frame, in which the ground is not at z = 0.
    """
    odom_T_raised = lifted(odom_T_scan, keys.lift_m)
    world_T_odom = world_T_key @ np.linalg.inv(keys.odom_T_key)
    # the keys before and after each scan, and its share of the way from the first to the second
    scans = np.arange(len(odom_T_scan))
    key_before = np.searchsorted(keys.rows, scans, side="right") - 1
    key_before = key_before.clip(0)
    key_after = (key_before + 1).clip(max=len(keys.rows) - 1)
    is_same_part = keys.parts[key_before] == keys.parts[key_after]
    key_after = np.where(is_same_part, key_after, key_before)
    between = (keys.rows[key_after] - keys.rows[key_before]).clip(1)
    share = ((scans - keys.rows[key_before]) / between).clip(0.0, 1.0)
    share[~is_same_part] = 0.0

    has_odometry = np.isfinite(odom_T_raised).all((1, 2))
    has_pose = has_odometry & np.isfinite(world_T_odom[key_before]).all((1, 2))
    before = world_T_odom[key_before[has_pose]]
    after = world_T_odom[key_after[has_pose]]
    world_T_odom_at_scan = interpolate(before, after, share[has_pose])
    world_T_scan = np.full_like(odom_T_scan, np.nan)
    raised_poses = world_T_odom_at_scan @ odom_T_raised[has_pose]
    world_T_scan[has_pose] = lifted(raised_poses, -keys.lift_m)
    return world_T_scan


def _connected(keys: Keys, loops: list[Loop], fixes: Sequence[KeyFix]) -> NDArray[np.bool_]:
    """The keys (k,) that loops connect with a fix; without fixes the largest connected set."""
    group = keys.parts.copy()
    for loop in loops:  # a loop merges the groups of its two keys
        group[group == group[loop.later]] = group[loop.key]
    if fixes:
        fixed_groups = {int(group[fix.key]) for fix in fixes}
        return np.isin(group, sorted(fixed_groups))
    return np.asarray(group == np.bincount(group).argmax())


def _start(
    keys: Keys, loops: list[Loop], members: NDArray[np.int64], fixes: Sequence[KeyFix]
) -> Poses:
    """First guesses (k, 4, 4) of all keys: each part by its odometry, placed by a fix or a loop."""
    start = keys.odom_T_key.copy()
    placed_parts: set[int] = set()

    def place(part: int, world_T_odom: Poses) -> None:
        """Move all keys of a part by the pose of its odometry's frame in the world."""
        rows = keys.parts == part
        start[rows] = world_T_odom @ keys.odom_T_key[rows]
        placed_parts.add(part)

    for fix in fixes:
        part = int(keys.parts[fix.key])
        if part not in placed_parts:
            place(part, fix.world_T_key @ np.linalg.inv(keys.odom_T_key[fix.key]))
    if not placed_parts:
        placed_parts.add(int(keys.parts[members[0]]))

    joins: list[tuple[int, int, Poses]] = []
    for loop in loops:  # in both directions: a key, another key, and the other's pose in its frame
        joins.append((loop.key, loop.later, loop.key_T_later))
        joins.append((loop.later, loop.key, np.asarray(np.linalg.inv(loop.key_T_later))))
    member_parts = set(keys.parts[members].tolist())
    while not member_parts <= placed_parts:
        for key, other, key_T_other in joins:
            part = int(keys.parts[other])
            if int(keys.parts[key]) in placed_parts and part not in placed_parts:
                place(part, start[key] @ key_T_other @ np.linalg.inv(keys.odom_T_key[other]))
    return start
