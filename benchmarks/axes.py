"""Do queries have the same principal axes as their nearest training pose, as M2DP needs?

`python -m benchmarks.axes campus TRAIN TEST TEST …` after `dvc repro`.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.evaluation.timing import clouds
from pipeline.views import m2dp_kernel as kernel
from pipeline.views.m2dp import principal_axes

EVERY = 4
"""One of so many submaps is measured."""
NEAR_M = 5.0
SAME = 0.9
"""Cosine of axes that count as the same: 26°."""


def world_axes(study: str, sequence: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where submaps are (n, 2), and their principal axes (n, 3, 3) as columns, in the world."""
    scans = store.read(Path("artifacts/scans", study, f"{sequence}.zarr"), schemas.Scans)
    submaps = store.read(Path("artifacts/submaps", study, f"{sequence}.zarr"), schemas.Submaps)
    poses = submaps.load("world_T_anchor")
    rows = np.arange(0, len(poses), EVERY)
    axes = [
        principal_axes(kernel.moments(np.ascontiguousarray(cloud))[1])
        for cloud in clouds(scans, submaps, rows)
    ]
    return poses[rows, :2, 3], poses[rows, :3, :3] @ np.stack(axes)


def measure(study: str, train: str, test: str) -> str:
    """Shares of the seen queries whose axes are the same, the same but for a sign, or others."""
    train_xy_m, trained = world_axes(study, train)
    xy_m, axes = world_axes(study, test)
    away_m = np.linalg.norm(xy_m[:, None] - train_xy_m, axis=2)
    seen = away_m.min(axis=1) < NEAR_M
    cosine = np.einsum("qij,qij->qj", axes, trained[away_m.argmin(axis=1)])[seen]
    same = (cosine > SAME).all(axis=1)
    flipped = (np.abs(cosine) > SAME).all(axis=1) & ~same
    shares = (
        f"same {same.mean():.3f}, flipped {flipped.mean():.3f}, turned "
        f"{1 - same.mean() - flipped.mean():.3f}"
    )
    return (
        f"{study} {test}: of {seen.sum()} queries within {NEAR_M:g} m of a training pose, "
        f"principal axes {shares}"
    )


if __name__ == "__main__":
    for date in sys.argv[3:]:
        print(measure(sys.argv[1], sys.argv[2], date))
