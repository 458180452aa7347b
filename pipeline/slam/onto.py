"""Further days: a drive's own odometry, laid onto the map of the training day by fixes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.readers.log import Log
from pipeline.slam.drive import Slam, estimated, ups
from pipeline.slam.keys import Keys
from pipeline.slam.odometry import Track

AGREEING = 2
"""Fixes that have to agree by odometry before a part of a drive is laid onto the map."""


@dataclass(frozen=True)
class KeyFix:
    """Where a key of a drive stands on the map."""

    key: int
    world_T_key: Poses
    """(4, 4) of the raised frame."""
    covariance: NDArray[np.float64]
    """(6, 6) of a turn in radians and a step in metres, in the key's frame."""


def estimate_onto(
    slam: Slam, log: Log, map_log: Log, map_poses: Poses, watch: Progress
) -> Estimates:
    """The poses of a drive in the world of a map, whose log has these poses (m, 4, 4).

    Raises LogError where no scan of the drive is found on it.
    """
    track, keys = slam.tracked(log, watch)
    map_keys = keys_of_map(slam, map_log, map_poses, watch)
    usual_overlap = float(np.nanmedian(track.overlap)) if len(track.overlap) > 1 else 0.0
    fixes = agreeing(slam, keys, key_fixes(slam, keys, map_keys, usual_overlap, watch))
    if not fixes:
        raise LogError(
            f"none of {len(log.stamps_ns)} scans was found on the map of the training sequence: "
            "did this day drive elsewhere? Give another training sequence, or leave this one out"
        )
    fixed = [(fix.key, fix.world_T_key, fix.covariance) for fix in fixes]
    solution = slam.graph.solve(keys, [], track.by_log[keys.rows], ups(keys), fixed)
    reason = "in a part of the drive that was not found on the map"
    fixed_rows = keys.rows[np.array([fix.key for fix in fixes], np.int64)]
    return estimated(log, track, keys, [], solution, reason, fixed_rows)


def keys_of_map(slam: Slam, log: Log, world_T_scan: Poses, watch: Progress) -> Keys:
    """The keys of a log that has poses (n, 4, 4), NaN of scans that are not in the map."""
    count = len(log.stamps_ns)
    no_breaks = np.empty(0, np.int64)
    track = Track(world_T_scan, np.full(count, np.nan), np.zeros(count, bool), no_breaks, {})
    return slam.keys(log, track, watch)


def key_fixes(
    slam: Slam, keys: Keys, map_keys: Keys, usual_overlap: float, watch: Progress
) -> list[KeyFix]:
    """The keys of a drive that are surely found on a map, by Scan Context and the search."""
    search = slam.loops
    targets = map_keys.targets(map_keys.odom_T_key, search.range_m)
    rows = np.arange(len(map_keys.rows))
    fixes = []
    queries = search.queries(keys)
    for key in watch.track(queries, len(queries), "fixes"):
        answers = search.candidates(map_keys, targets, keys.heights_m[key], rows)
        fix = search.fixer.fix(keys.points_m(key), targets, answers)
        if not fix.hypotheses or fix.chance < search.sure:
            continue
        best = fix.hypotheses[0]
        if search.overlap(keys, targets, key, best) >= search.least * usual_overlap:
            fixes.append(KeyFix(key, best.world_T_query, best.alignment.covariance))
    return fixes


def agreeing(slam: Slam, keys: Keys, fixes: list[KeyFix]) -> list[KeyFix]:
    """Of each part of a drive the most fixes that agree with one of them by odometry."""
    kept: list[KeyFix] = []
    for part in sorted({int(keys.parts[fix.key]) for fix in fixes}):
        of_part = [fix for fix in fixes if keys.parts[fix.key] == part]
        rows = np.array([fix.key for fix in of_part])
        world_T_key = np.stack([fix.world_T_key for fix in of_part])
        odom_T_key = keys.odom_T_key[rows]
        near = np.array(
            [
                slam.loops.drifted(
                    world_T_key[i] @ np.linalg.inv(odom_T_key[i]) @ odom_T_key,
                    world_T_key,
                    np.abs(keys.path_m[rows] - keys.path_m[rows[i]]),
                )
                for i in range(len(rows))
            ]
        )
        best = near[near.sum(axis=1).argmax()]
        if best.sum() >= AGREEING:
            kept += [fix for fix, is_near in zip(of_part, best, strict=True) if is_near]
    return kept
