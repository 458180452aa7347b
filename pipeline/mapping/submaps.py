"""Submaps: which scans make one, and around which pose. A 3D scan is its own submap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError
from pipeline.frames import Poses
from pipeline.settings import check


@dataclass(frozen=True)
class SingleScan:
    """One scan a submap, one submap every `step_m` of path."""

    step_m: float = 1.0

    def __post_init__(self) -> None:
        check(self, "submap")
        if not self.step_m >= 0:
            raise ConfigError(f"submap.step_m={self.step_m}: expected a length, or 0 for every scan")

    def anchors(self, world_T_scan: Poses) -> NDArray[np.int64]:
        """Rows of the scans that become submaps."""
        return sample_path(world_T_scan[:, :3, 3], self.step_m) if self.step_m > 0 else np.arange(len(world_T_scan))


def sample_path(xyz_m: NDArray[np.float64], step_m: float) -> NDArray[np.int64]:
    """Rows (m,) of positions (n, 3) sampled along the path (METHODS 2.2).

    The 3D steps between consecutive rows add up; at `step_m` or more a sample is taken and the sum starts at zero. Rows with
    a NaN are skipped, and a step across them does not count.
    """
    steps = np.linalg.norm(np.diff(xyz_m, axis=0), axis=1)
    known: NDArray[np.bool_] = np.all(np.isfinite(xyz_m), axis=1)
    rows, travelled = [], 0.0
    for row, step in enumerate(np.where(np.isfinite(steps), steps, 0.0).tolist(), start=1):
        travelled += step
        if travelled >= step_m and known[row]:
            rows.append(row)
            travelled = 0.0
    return np.array(rows, np.int64)
