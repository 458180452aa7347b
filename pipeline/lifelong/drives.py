"""Drives of a study as scans in their order, with odometry and true poses.

True poses serve to count errors only.
"""

from collections.abc import Callable, Sequence
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
    rows = enumerate(
        zip(submaps.load("stamps_ns"), odom_T_anchor, submaps.load("world_T_anchor"), strict=True)
    )
    return [
        Scan(f"{sequence} {row}", int(stamp), _points(scans, submaps, row), *poses)
        for row, (stamp, *poses) in rows
    ]


def _points(
    scans: schemas.Scans, submaps: schemas.Submaps, row: int
) -> Callable[[], NDArray[np.float64]]:
    return partial(
        lambda row: np.asarray(
            next(iter(submap_points(scans, submaps, slice(row, row + 1)))), np.float64
        ),
        row,
    )
