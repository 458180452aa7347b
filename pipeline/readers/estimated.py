"""Logs whose poses were estimated from their scans (the stage `slam`)."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.readers.deskew import scan_at_stamp
from pipeline.readers.log import Log


def poses_of(path: Path, log: Log) -> Poses:
    """The poses (n, 4, 4) of a log's scans by an artifact; NaN where it has none.

    Raises LogError where it is of another log.
    """
    artifact = store.read(path, schemas.Estimates)
    if not np.array_equal(artifact.stamps_ns, log.stamps_ns):
        raise LogError(f"{path}: is of another log, its stamps differ; `dvc repro` builds it anew")
    return artifact.world_T_scan


def posed(log: Log, path: Path) -> Log:
    """The scans of a log that an artifact has poses of, their points as they lay at the stamp.

    Where the log has no odometry, that of the artifact is taken. The others are counted as skipped.
    """
    world_T_scan = poses_of(path, log)
    artifact = store.read(path, schemas.Estimates)
    odom_T_scan = log.odom_T_scan
    if not np.isfinite(odom_T_scan).all(axis=(1, 2)).any():
        odom_T_scan = artifact.odom_T_scan.copy()
        odom_T_scan[artifact.breaks] = np.nan
    rows = np.flatnonzero(np.isfinite(world_T_scan).all(axis=(1, 2)))
    unknown = ~np.isfinite(odom_T_scan).all(axis=(1, 2))
    broken = np.concatenate([[0], np.cumsum(unknown)])
    odom_T_posed = odom_T_scan[rows]
    odom_T_posed[broken[rows] > broken[np.concatenate([[0], rows[:-1] + 1])]] = np.nan
    unposed = len(world_T_scan) - len(rows)
    skipped = Counter({"no pose by slam": unposed}) if unposed else Counter()
    at_stamps = replace(
        log,
        points=lambda row: scan_at_stamp(log, artifact.odom_T_scan, artifact.breaks, row),
        times_s=lambda row: None,
    )
    return replace(
        at_stamps.of(rows),
        world_T_scan=world_T_scan[rows],
        odom_T_scan=odom_T_posed,
        skipped=log.skipped + skipped,
    )
