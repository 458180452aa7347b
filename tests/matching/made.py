"""Makes the rows of a straight drive, for tests of methods."""

from typing import Any

import numpy as np

from pipeline.core.frames import pose
from pipeline.matching.ranking import Rows


def along(images: Any, step_m: float = 1.0, yaw_deg: np.ndarray | float = 0.0) -> Rows:
    """Rows with an image every `step_m` along x, of a robot with this yaw, or these."""
    n = len(images)
    xyz_m = np.outer(step_m * np.arange(n), [1, 0, 0])
    rpy_rad = np.outer(np.deg2rad(np.broadcast_to(yaw_deg, n)), [0, 0, 1])
    return Rows(images, np.arange(n), pose(xyz_m, rpy_rad))
