"""Joins a log that has no true poses with the poses that the stage `slam` estimated from its scans.

A log and the artifact of its estimates in; a log out that can be learned like one with true poses.
"""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.readers.deskew import scan_at_stamp
from pipeline.readers.log import Log


def with_estimated_poses(log: Log, path: Path) -> Log:
    """The log of those scans that have a pose in the artifact at `path`.

    The estimated poses become the true ones. The points are deskewed: they lie as at the stamp of
    their scan. A log without odometry gets the odometry of the artifact. Scans without an estimate
    are counted in `skipped`. Raises LogError if the artifact belongs to another log.
    """
    estimates = estimates_of(log, path)
    odom_T_scan = log.odom_T_scan
    has_odometry = np.isfinite(odom_T_scan).all(axis=(1, 2)).any()
    if not has_odometry:
        odom_T_scan = estimates.odom_T_scan.copy()
        odom_T_scan[estimates.breaks] = np.nan
    rows = np.flatnonzero(np.isfinite(estimates.world_T_scan).all(axis=(1, 2)))
    unposed_count = len(estimates.world_T_scan) - len(rows)
    skipped: Counter[str] = Counter()
    if unposed_count:
        skipped["no pose by slam"] = unposed_count
    deskewed_log = replace(
        log,
        points=lambda row: scan_at_stamp(log, estimates.odom_T_scan, estimates.breaks, row),
        times_s=lambda row: None,
    )
    return replace(
        deskewed_log.select(rows),
        world_T_scan=estimates.world_T_scan[rows],
        odom_T_scan=_odometry_of(rows, odom_T_scan),
        skipped=log.skipped + skipped,
    )


def estimates_of(log: Log, path: Path) -> schemas.Estimates:
    """The estimates of a log in the artifact at `path`; LogError if the stamps differ."""
    estimates = store.read(path, schemas.Estimates)
    if not np.array_equal(estimates.stamps_ns, log.stamps_ns):
        raise LogError(f"{path}: is of another log, its stamps differ; `dvc repro` rebuilds it")
    return estimates


def _odometry_of(rows: NDArray[np.int64], odom_T_scan: Poses) -> Poses:
    """The odometry (k, 4, 4) of the `rows` (k,) of a log with odometry (n, 4, 4)."""
    # A NaN marks a break in the odometry. If the broken row is not among `rows`, the next one of
    # them becomes NaN in its place.
    is_break = ~np.isfinite(odom_T_scan).all(axis=(1, 2))
    breaks_before = np.concatenate([[0], np.cumsum(is_break)])
    after_previous_row = np.concatenate([[0], rows[:-1] + 1])
    odom_T_rows = odom_T_scan[rows]
    odom_T_rows[breaks_before[rows] > breaks_before[after_previous_row]] = np.nan
    return odom_T_rows
