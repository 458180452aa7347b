"""A drive's poses from its scans alone: odometry, loops, graph, and what is known of the result."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.mapping.appearance import is_level
from pipeline.paths.graph import imported_gtsam
from pipeline.posing.registration import Cloud, Registration
from pipeline.readers.log import Log, lifted
from pipeline.slam.graph import DriveGraph, Solution, spread_over_scans
from pipeline.slam.keys import NEAR_M, Keys
from pipeline.slam.loops import Loop, LoopSearch
from pipeline.slam.odometry import LYING, ScanOdometry, Track

LOOKED_AT = 5
"""Scans that are looked at before the work begins."""
FARTHEST_M = 500.0
"""No LiDAR of a robot sees most of its points farther off: they are millimetres."""
NONE = np.empty(0, np.int64)


@dataclass(frozen=True)
class Slam:
    """How poses are estimated (conf/slam.yaml)."""

    odometry: ScanOdometry = field(default_factory=ScanOdometry)
    loops: LoopSearch = field(default_factory=LoopSearch)
    graph: DriveGraph = field(default_factory=DriveGraph)
    use_log_odometry: bool = True
    """Whether the log's own odometry, where it has some, is the first guess of each step."""

    def estimate(self, log: Log, watch: Progress) -> Estimates:
        """The poses of a log, in a world that begins at its first scan, z up from the ground.

        Raises LogError for scans that no pose can come of, ConfigError where gtsam is missing.
        """
        track, keys = self.tracked(log, watch)
        usual_overlap = float(np.nanmedian(track.overlap)) if len(track.overlap) > 1 else 0.0
        loops = self.loops.within(keys, usual_overlap, watch)
        solution = self.graph.solve(keys, loops, track.by_log[keys.rows], ups(keys))
        return estimated(log, track, keys, loops, solution)

    def tracked(self, log: Log, watch: Progress) -> tuple[Track, Keys]:
        """The odometry of a log by registration, and its keys.

        Raises LogError and ConfigError as `estimate`.
        """
        imported_gtsam()  # what the graph lacks is said before the odometry, which takes minutes
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
        """The keys of a log with a track."""
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
    """Raise LogError for a log whose scans no pose can come of: level sweeps, millimetres."""
    count = len(log.stamps_ns)
    clouds_m = []
    ranges_m = []
    for row in np.unique(np.linspace(0, count - 1, LOOKED_AT).astype(int)).tolist():
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


def ups(keys: Keys) -> NDArray[np.float64]:
    """The normal (k, 3) of the ground around each key, in its frame; NaN where little is seen."""
    registration = Registration()
    ground = np.full((len(keys.rows), 3), np.nan)
    for key in range(len(keys.rows)):
        points_m = keys.points_m(key)
        near = np.hypot(points_m[:, 0], points_m[:, 1]) < NEAR_M
        if near.sum() >= registration.least_voxels:
            ground[key] = _up(registration.prepare(np.ascontiguousarray(points_m[near])))
    return ground


def _up(cloud: Cloud) -> NDArray[np.float64]:
    normals = cloud.normals * np.where(cloud.normals[:, 2:] < 0, -1.0, 1.0)
    lying = normals[normals[:, 2] > LYING]
    if len(lying) < 10:
        return np.full(3, np.nan)
    mean = np.median(lying, axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def estimated(
    log: Log,
    track: Track,
    keys: Keys,
    loops: list[Loop],
    solution: Solution,
    reason: str = "in a part of the drive that no loop joins with the longest",
    fixed: NDArray[np.int64] = NONE,
) -> Estimates:
    """The estimate for all scans, from that of their keys.

    `reason` is why scans with odometry may have no pose; `fixed` (m,) are scans found on a map.
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


def without_truth(log: Log) -> Log:
    """A log as if it had no true poses."""
    return replace(log, world_T_scan=np.full_like(log.world_T_scan, np.nan))
