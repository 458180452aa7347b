"""Shared parts of the writers that write one file per scan."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, rpy


@dataclass(frozen=True)
class FilesWriter:
    """One sequence and its folder. Each scan is a file, so any worker may write any scan."""

    folder: Path
    sequence: str
    body_T_sensor: Poses
    in_order: ClassVar[bool] = False

    def close(self) -> None:
        """Nothing is open."""


def xyzrpy(poses: Poses) -> NDArray[np.float64]:
    """Rows (n, 6) of x, y, z in metres and roll, pitch, yaw in radians of poses (n, 4, 4)."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])
