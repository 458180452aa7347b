"""Reads drives of a study from its artifacts, as the scans that a site is asked about in order.

Each scan has odometry, and its true pose, by which errors are counted and nothing else is done.
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
    """The scans of each sequence, by its name; each submap is one scan.

    `scans` and `submaps` are the folders of these artifacts.
    """
    return {
        name: _scans(scans / f"{name}.zarr", submaps / f"{name}.zarr", name) for name in sequences
    }


def _scans(scans_path: Path, submaps_path: Path, sequence: str) -> list[Scan]:
    """The scans of one sequence, whose points are read only when asked for."""
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
