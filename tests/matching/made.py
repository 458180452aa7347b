"""Drives along x, that tests of methods look at."""

from typing import Any

import numpy as np

from pipeline.core.frames import pose
from pipeline.matching.ranking import Rows


def along(images: Any, step_m: float = 1.0, yaw_deg: np.ndarray | float = 0.0) -> Rows:
    """A view every `step_m`, of a robot that looks this way."""
    n = len(images)
    x_m = np.outer(step_m * np.arange(n), [1, 0, 0])
    ahead = np.outer(np.deg2rad(np.broadcast_to(yaw_deg, n)), [0, 0, 1])
    return Rows(images, np.arange(n), pose(x_m, ahead))
