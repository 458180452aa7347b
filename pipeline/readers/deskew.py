"""Deskews scans: moves the points of a scan to where they lay at its stamp.

A LiDAR takes about 0.1 s for one scan, and the vehicle drives meanwhile, so the points are
distorted. Each point is moved by the vehicle's motion between its own time and the stamp, which is
interpolated between the poses of neighbouring scans.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import Poses
from pipeline.readers.log import Log

SLICES = 64
"""A scan is cut into so many slices of equal time, each moved as one rigid piece: at 20 m/s and
ten scans a second a slice is 3 cm of path."""
NO_BREAKS = np.empty(0, np.int64)
"""For `breaks` of poses that never start again."""


class Step(NamedTuple):
    """The motion of the vehicle from one scan to the next."""

    before_T_here: Poses
    """(4, 4) pose of the scan in the frame of the one before."""
    seconds: float


def scan_at_stamp(
    log: Log, odom_T_scan: Poses, breaks: NDArray[np.int64], row: int
) -> NDArray[np.float64]:
    """The deskewed points (n, 3) in metres of the scan `row` of a log, in the vehicle's frame.

    `odom_T_scan` (scan, 4, 4) are the poses of all scans; between two of them the vehicle is taken
    to move steadily. At the scans `breaks` (k,) the poses start again. Points that were measured
    before the stamp are moved by the step from the scan before, the others by the step to the scan
    after. Without times of the points, or without a step, the points stay as they are. Raises
    LogError if the scan cannot be read.
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
        only_step = to_here or from_here
        return points_m if only_step is None else deskewed(points_m, times_s, *only_step)
    is_after_stamp = times_s > 0
    is_before_stamp = ~is_after_stamp
    points_m[is_before_stamp] = deskewed(
        points_m[is_before_stamp], times_s[is_before_stamp], *to_here
    )
    points_m[is_after_stamp] = deskewed(
        points_m[is_after_stamp], times_s[is_after_stamp], *from_here
    )
    return points_m


def _step(log: Log, odom_T_scan: Poses, breaks: NDArray[np.int64], row: int) -> Step | None:
    """The step to the scan `row` from the one before; None where it is not known."""
    if not 0 < row < len(log.stamps_ns) or row in breaks:
        return None
    before_T_here = np.linalg.inv(odom_T_scan[row - 1]) @ odom_T_scan[row]
    if not np.isfinite(before_T_here).all():
        return None
    return Step(before_T_here, float(log.stamps_ns[row] - log.stamps_ns[row - 1]) / 1e9)


def deskewed(
    points_m: NDArray[np.floating],
    times_s: NDArray[np.float64] | None,
    step: Poses,
    step_s: float,
) -> NDArray[np.float64]:
    """Points (n, 3) in the vehicle's frame at the stamp.

    Each point is given in the vehicle's frame at its own time, `times_s` (n,) seconds after the
    stamp. The vehicle moves steadily, by `step` (4, 4) in `step_s` seconds. Points stay as they are
    if their times are None or the step is not finite.
    """
    points = np.asarray(points_m, np.float64)
    if times_s is None or not len(points) or not step_s > 0 or not np.isfinite(step).all():
        return points
    # 1. Find the slice of each point; all are in the first slice if they have one time.
    first_s = float(times_s.min())
    span_s = float(times_s.max()) - first_s
    slices = (SLICES * (times_s - first_s) / (span_s or 1.0)).astype(np.int64).clip(0, SLICES - 1)
    # 2. Compute the share of the step that the vehicle has moved in the middle of each slice.
    shares = (first_s + (np.arange(SLICES) + 0.5) * (span_s / SLICES)) / step_s
    # 3. Move each slice by this share of the step's rotation and of its translation.
    rotation_vector = Rotation.from_matrix(step[:3, :3]).as_rotvec()
    rotations = Rotation.from_rotvec(rotation_vector * shares[:, None]).as_matrix()
    moves_m = step[:3, 3] * shares[:, None]
    return np.asarray(np.einsum("nij,nj->ni", rotations[slices], points) + moves_m[slices])
