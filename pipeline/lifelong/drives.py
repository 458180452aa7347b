"""Drives of a study as a site is asked about them: artifacts in; scans in their order out.

Each has odometry, and its true pose, which serves to count errors only.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.mapping.gathering import submap_points
from pipeline.online.inputs import Scan


def read(scans: Path, submaps: Path, sequences: Sequence[str]) -> dict[str, list[Scan]]:
    """The scans of each sequence in two folders: its submaps, each of which is one scan."""
    return {
        name: _scans(scans / f"{name}.zarr", submaps / f"{name}.zarr", name) for name in sequences
    }


def _scans(scans_path: Path, submaps_path: Path, sequence: str) -> list[Scan]:
    scans = store.read(scans_path, schemas.Scans)
    submaps = store.read(submaps_path, schemas.Submaps)
    odom_T_anchor = scans.load("odom_T_scan")[submaps.load("scans")]
    stamps_ns = submaps.load("stamps_ns").tolist()
    world_T_anchor = submaps.load("world_T_anchor")
    return [
        Scan(
            f"{sequence} {row}",
            stamps_ns[row],
            partial(_points, scans, submaps, row),
            odom_T_anchor[row],
            world_T_anchor[row],
        )
        for row in range(len(stamps_ns))
    ]


def _points(scans: schemas.Scans, submaps: schemas.Submaps, row: int) -> NDArray[np.float64]:
    """The points (n, 3) of one submap."""
    (points_m,) = submap_points(scans, submaps, slice(row, row + 1))
    return np.asarray(points_m, np.float64)
