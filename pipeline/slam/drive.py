"""Estimates the poses of a drive from its scans, for `yearloc slam` and the stage `slam`.

In: a log without poses. Out: an `Estimates` artifact (METHODS 12). The steps:

1. Odometry aligns each scan with those before it (odometry.py).
2. Some scans, one every few metres, become keys (keys.py).
3. Loops join keys at the same place (loops.py).
4. A graph of keys finds the poses that fit odometry and loops best (graph.py).
5. The poses of the keys are carried over to the scans between them.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.mapping.appearance import is_level
from pipeline.paths.pose_graph import imported_gtsam
from pipeline.posing.registration import Cloud, Registration
from pipeline.readers.log import Log, lifted
from pipeline.slam.graph import DriveGraph, Solution, spread_over_scans
from pipeline.slam.keys import NEAR_M, Keys
from pipeline.slam.loops import Loop, LoopSearch
from pipeline.slam.odometry import LYING_NORMAL_Z, ScanOdometry, Track

LOOKED_AT = 5
"""Number of scans of a log, evenly spread, that are checked before the estimation starts."""
FARTHEST_M = 500.0
"""Points of a larger median distance are taken to be in millimetres: no LiDAR sees this far."""
FEWEST_LYING = 10
"""The ground's normal is unknown if fewer voxels around a key lie flat."""
NO_SCANS = np.empty(0, np.int64)


@dataclass(frozen=True)
class Slam:
    """How poses are estimated (conf/slam.yaml)."""

    odometry: ScanOdometry = field(default_factory=ScanOdometry)
    loops: LoopSearch = field(default_factory=LoopSearch)
    graph: DriveGraph = field(default_factory=DriveGraph)
    use_log_odometry: bool = True
    """Whether the first guess of each step is that of the log's own odometry, if it has any."""

    def estimate(self, log: Log, watch: Progress) -> Estimates:
        """The poses of a log, in a world whose origin is its first scan, z up from the ground.

        Raises LogError for scans that cannot be registered, NotInstalledError without gtsam.
        """
        track, keys = self.tracked(log, watch)
        loops = self.loops.within(keys, track.usual_overlap, watch)
        solution = self.graph.solve(keys, loops, track.by_log[keys.rows], ground_normals(keys))
        return estimated(log, track, keys, loops, solution)

    def tracked(self, log: Log, watch: Progress) -> tuple[Track, Keys]:
        """The odometry of a log by registration, and its keys.

        Raises the same errors as `estimate`.
        """
        imported_gtsam()  # if gtsam is missing, say so before the odometry, which takes minutes
        refuse_unusable(log)
        track = self.odometry.along(log, watch, self.use_log_odometry)
        count = len(log.stamps_ns)
        if len(track.breaks) > count / 2:
            step_s = float(np.median(np.diff(log.stamps_ns))) / 1e9
            raise LogError(
                f"neighbouring scans do not overlap at {len(track.breaks)} of {count} scans, which "
                f"are {step_s:.3g} s apart: record more scans a second, or drive more slowly"
            )
        return track, self.keys(log, track, watch)

    def keys(self, log: Log, track: Track, watch: Progress) -> Keys:
        """The keys of a log whose odometry is `track`."""
        return Keys.read(
            log,
            track,
            self.loops.every_m,
            self.odometry.registration.voxel_m,
            self.loops.range_m,
            self.loops.view,
            watch,
        )


def refuse_unusable(log: Log) -> None:
    """Raise LogError for scans that cannot be registered: level sweeps, points in millimetres."""
    count = len(log.stamps_ns)
    spread_rows = np.unique(np.linspace(0, count - 1, LOOKED_AT).astype(int))
    clouds_m = []
    ranges_m = []
    for row in spread_rows.tolist():
        try:
            points_m = np.asarray(log.points(row), np.float64)
        except LogError:
            continue
        if len(points_m):
            clouds_m.append(points_m)
            ranges_m.append(float(np.median(np.linalg.norm(points_m, axis=1))))
    if is_level(clouds_m):
        raise LogError(
            "all points of a scan lie in one plane: sweeps of a level 2-D LiDAR, of which no poses "
            "are estimated here; another program's poses can stand beside them"
        )
    if ranges_m and np.median(ranges_m) > FARTHEST_M:
        raise LogError(
            f"points lie {np.median(ranges_m):,.0f} m from the sensor in the median: are they in "
            "millimetres? Expected metres"
        )


def ground_normals(keys: Keys) -> NDArray[np.float64]:
    """The upward normal (k, 3) of the ground around each key, in the key's frame.

    It is NaN if too little of the ground is seen.
    """
    registration = Registration()
    normals = np.full((len(keys.rows), 3), np.nan)
    for key in range(len(keys.rows)):
        points_m = keys.points_m(key)
        near = np.hypot(points_m[:, 0], points_m[:, 1]) < NEAR_M
        if near.sum() >= registration.least_voxels:
            cloud = registration.prepare(np.ascontiguousarray(points_m[near]))
            normals[key] = _median_upward_normal(cloud)
    return normals


def _median_upward_normal(cloud: Cloud) -> NDArray[np.float64]:
    """The median normal (3,) of the voxels of a cloud that lie flat; NaN if there are too few."""
    # the sign of a normal is arbitrary: turn all normals upwards
    upward = cloud.normals * np.where(cloud.normals[:, 2:] < 0, -1.0, 1.0)
    flat_normals = upward[upward[:, 2] > LYING_NORMAL_Z]
    if len(flat_normals) < FEWEST_LYING:
        return np.full(3, np.nan)
    median = np.median(flat_normals, axis=0)
    return np.asarray(median / np.linalg.norm(median))


def estimated(
    log: Log,
    track: Track,
    keys: Keys,
    loops: list[Loop],
    solution: Solution,
    reason: str = "in a part of the drive that no loop joins with the longest",
    fixed: NDArray[np.int64] = NO_SCANS,
) -> Estimates:
    """The estimate for all scans of a log, from the poses of its keys by the graph.

    `reason` says why a scan with odometry may have no pose. `fixed` (m,) are the rows of the scans
    that were located on a map.
    """
    world_T_scan = spread_over_scans(keys, solution.world_T_key, track.odom_T_scan)
    skipped = dict(track.skipped)
    without_pose = (~np.isfinite(world_T_scan) & np.isfinite(track.odom_T_scan)).all((1, 2))
    if without_pose.any():
        skipped[reason] = int(without_pose.sum())
    key_T_later = np.array([loop.key_T_later for loop in loops]).reshape(-1, 4, 4)
    return Estimates(
        stamps_ns=log.stamps_ns,
        odom_T_scan=track.odom_T_scan,
        world_T_scan=world_T_scan,
        overlap=track.overlap,
        by_log=track.by_log,
        breaks=track.breaks,
        fixed=fixed,
        earlier=keys.rows[np.array([loop.key for loop in loops], np.int64)],
        later=keys.rows[np.array([loop.later for loop in loops], np.int64)],
        earlier_T_later=lifted(key_T_later, -keys.lift_m),
        residual_m=solution.residual_m,
        residual_deg=solution.residual_deg,
        used=solution.used,
        skipped=skipped,
    )


def without_ground_truth(log: Log) -> Log:
    """The same log, with NaN for all of its true poses."""
    return replace(log, world_T_scan=np.full_like(log.world_T_scan, np.nan))
