"""Estimates the poses of a further day's drive on the map of the training day (METHODS 12.4).

1. Compute the drive's odometry and keys as on the training day (drive.py).
2. Search for each key among all keys of the training day. A key located there with a high
   probability is a fix.
3. In each part of the drive, keep the fixes that agree with each other by odometry.
4. Optimise the graph of the drive's odometry and these fixes.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.readers.log import Log
from pipeline.slam.drive import Slam, estimated, ground_normals
from pipeline.slam.graph import KeyFix
from pipeline.slam.keys import Keys
from pipeline.slam.loops import agreeing
from pipeline.slam.odometry import Track

AGREEING = 2
"""A part of a drive is aligned with the map if this many of its fixes, or more, agree."""


def estimate_onto(
    slam: Slam, log: Log, map_log: Log, map_poses: Poses, watch: Progress
) -> Estimates:
    """The poses of a drive in the world of a map.

    The map is another log, `map_log`, with the poses `map_poses` (m, 4, 4). Raises LogError if no
    scan of the drive can be located on the map.
    """
    track, keys = slam.tracked(log, watch)
    map_keys = keys_of_map(slam, map_log, map_poses, watch)
    sure_fixes = key_fixes(slam, keys, map_keys, track.usual_overlap, watch)
    fixes = agreeing(
        sure_fixes,
        lambda fix: (int(keys.parts[fix.key]),),
        lambda fix, others: _agreeing_with(slam, keys, fix, others),
        AGREEING,
    )
    if not fixes:
        raise LogError(
            f"none of {len(log.stamps_ns)} scans was found on the map of the training sequence: "
            "did this day drive elsewhere? Give another training sequence, or leave this one out"
        )
    solution = slam.graph.solve(keys, [], track.by_log[keys.rows], ground_normals(keys), fixes)
    reason = "in a part of the drive that was not found on the map"
    fixed_rows = keys.rows[np.array([fix.key for fix in fixes], np.int64)]
    return estimated(log, track, keys, [], solution, reason, fixed_rows)


def keys_of_map(slam: Slam, log: Log, world_T_scan: Poses, watch: Progress) -> Keys:
    """The keys of a log with poses (n, 4, 4), which are NaN for scans that are not in the map."""
    count = len(log.stamps_ns)
    no_breaks = np.empty(0, np.int64)
    track = Track(world_T_scan, np.full(count, np.nan), np.zeros(count, bool), no_breaks, {})
    return slam.keys(log, track, watch)


def key_fixes(
    slam: Slam, keys: Keys, map_keys: Keys, usual_overlap: float, watch: Progress
) -> list[KeyFix]:
    """The keys of a drive that are located on a map, with the overlap and probability of loops."""
    search = slam.loops
    targets = map_keys.targets(map_keys.odom_T_key, search.range_m)
    everywhere = np.ones(len(map_keys.rows), bool)
    fixes = []
    queries = search.queries(keys)
    for key in watch.track(queries, len(queries), "fixes"):
        loop = search.loop(keys, key, map_keys, targets, everywhere, usual_overlap)
        if loop and loop.probability >= search.sure:
            world_T_key = map_keys.odom_T_key[loop.key] @ loop.key_T_later
            fixes.append(KeyFix(key, world_T_key, loop.covariance))
    return fixes


def _agreeing_with(slam: Slam, keys: Keys, fix: KeyFix, fixes: list[KeyFix]) -> NDArray[np.bool_]:
    """Which fixes (n,) of a part agree with `fix` by odometry, within its drift."""
    rows = np.array([other.key for other in fixes])
    world_T_key = np.stack([other.world_T_key for other in fixes])
    world_T_odom = fix.world_T_key @ np.linalg.inv(keys.odom_T_key[fix.key])
    between_m = np.abs(keys.path_m[rows] - keys.path_m[fix.key])
    return slam.loops.drifted(world_T_odom @ keys.odom_T_key[rows], world_T_key, between_m)
