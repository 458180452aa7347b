"""Deskewing: the points of a scan as they lay at its stamp, though the vehicle drove meanwhile."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import Poses

SLICES = 64
"""A scan is cut into so many slices of equal time, each moved as one rigid piece: at 20 m/s and
ten scans a second a slice is 3 cm of path."""


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
    slice_s = (float(times_s.max()) - first_s) / SLICES
    if slice_s <= 0:
        return points
    slices = ((times_s - first_s) / slice_s).astype(np.int64).clip(0, SLICES - 1)
    shares = (first_s + (np.arange(SLICES) + 0.5) * slice_s) / step_s
    turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
    rotations = Rotation.from_rotvec(turn * shares[:, None]).as_matrix()
    moves_m = step[:3, 3] * shares[:, None]
    return np.asarray(np.einsum("nij,nj->ni", rotations[slices], points) + moves_m[slices])
