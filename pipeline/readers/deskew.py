"""Deskewing: the points of a scan as they lay at its stamp, though the vehicle drove meanwhile."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import Poses
from pipeline.readers.log import Log

SLICES = 64
"""A scan is cut into so many slices of equal time, each moved as one rigid piece: at 20 m/s and
ten scans a second a slice is 3 cm of path."""
NO_BREAKS = np.empty(0, np.int64)


def scan_at_stamp(
    log: Log, odom_T_scan: Poses, breaks: NDArray[np.int64], row: int
) -> NDArray[np.float64]:
    """The points (n, 3) of a scan of a log as they lay at its stamp, by poses (scan, 4, 4).

    Between two scans the vehicle moves steadily. `breaks` (k,) are scans at which the poses start
    anew. Raises LogError where the scan cannot be read.
    """
    points_m = np.array(log.points(row), np.float64)  # a copy: a log may hand out what it keeps
    to_here = _step(log, odom_T_scan, breaks, row)
    from_here = _step(log, odom_T_scan, breaks, row + 1)
    if to_here is None and from_here is None:
        return points_m
    times_s = log.times_s(row)
    if times_s is None:
        return points_m
    if to_here is None or from_here is None:
        step = to_here or from_here
        return points_m if step is None else deskewed(points_m, times_s, *step)
    is_later = times_s > 0
    points_m[~is_later] = deskewed(points_m[~is_later], times_s[~is_later], *to_here)
    points_m[is_later] = deskewed(points_m[is_later], times_s[is_later], *from_here)
    return points_m


def _step(
    log: Log, odom_T_scan: Poses, breaks: NDArray[np.int64], row: int
) -> tuple[Poses, float] | None:
    """The pose of a scan in the frame of the one before, and the seconds between them."""
    if not 0 < row < len(log.stamps_ns) or row in breaks:
        return None
    step = np.linalg.inv(odom_T_scan[row - 1]) @ odom_T_scan[row]
    if not np.isfinite(step).all():
        return None
    return step, float(log.stamps_ns[row] - log.stamps_ns[row - 1]) / 1e9


def deskewed(
    points_m: NDArray[np.floating],
    times_s: NDArray[np.float64] | None,
    step: Poses,
    step_s: float,
) -> NDArray[np.float64]:
    """Points (n, 3) in the vehicle's frame at the stamp, from points each in that of its own time.

    `times_s` (n,) are seconds after the stamp, None where they are unknown; then, and where the
    motion is, points stay as they are. The vehicle moves steadily: by `step` (4, 4), the pose of
    this scan in the frame of the one before, in `step_s` seconds.
    """
    points = np.asarray(points_m, np.float64)
    if times_s is None or not len(points) or not step_s > 0 or not np.isfinite(step).all():
        return points
    first_s = float(times_s.min())
    span_s = float(times_s.max()) - first_s
    slices = (SLICES * (times_s - first_s) / (span_s or 1.0)).astype(np.int64).clip(0, SLICES - 1)
    shares = (first_s + (np.arange(SLICES) + 0.5) * (span_s / SLICES)) / step_s
    turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
    rotations = Rotation.from_rotvec(turn * shares[:, None]).as_matrix()
    moves_m = step[:3, 3] * shares[:, None]
    return np.asarray(np.einsum("nij,nj->ni", rotations[slices], points) + moves_m[slices])
