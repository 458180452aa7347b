"""Poses as rows of numbers."""

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, rpy


def xyzrpy(poses: Poses) -> NDArray[np.float64]:
    """Rows (n, 6) of x, y, z in metres and roll, pitch, yaw in radians."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])
