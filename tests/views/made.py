"""Makes artifacts of scans and submaps as the stages write them, small enough to tell by hand what
their views show.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import store
from pipeline.core.frames import pose
from pipeline.mapping.octree import Octree
from pipeline.views.birdview import BirdView
from tests.artifacts import write_scans, write_submaps

Artifacts = tuple[store.Artifact, store.Artifact]

BIRDVIEW = BirdView(
    octree=Octree(edge_m=16.0, depth=5, motion="none"), headings=8, side_px=16, jitter_m=0.0
)
"""Bird-views of 16 m, in which a leaf is half a metre and a pixel is a metre."""
POLES_M = np.array([[4.25, 0.25], [-0.25, 3.25], [0.25, -5.25]])
"""Poles in the world: ahead, to the left and to the right of where the robot starts. Scan i sees
only pole i."""
ALONG = pose(np.arange(3)[:, None] * (0.5, 0, 0), np.zeros((3, 3)))
"""Three poses half a metre apart."""


def artifacts(
    folder: Path,
    points: Sequence[np.ndarray],
    world_T_scan: np.ndarray,
    odom_T_scan: np.ndarray | None = None,
    *,
    odom_variance: np.ndarray | None = None,
    first: Sequence[int] = (),
    last: Sequence[int] = (),
    stamps_ns: Sequence[int] = (),
    ground_m: float = 0.0,
    **attrs: Any,
) -> Artifacts:
    """Write the artifacts of scans and submaps, and open both.

    There is a submap of each scan, or one of the scans from each of `first` to each of `last`.
    """
    stamps = np.array(stamps_ns or range(len(points)))
    rows = np.array(last or range(len(points)))
    of_scans = write_scans(
        folder / "scans.zarr",
        points,
        world_T_scan,
        odom_T_scan=odom_T_scan,
        odom_variance=odom_variance,
        stamps_ns=stamps,
    )
    of_submaps = write_submaps(
        folder / "submaps.zarr",
        world_T_scan[rows],
        stamps_ns=stamps[rows],
        first=np.array(first or rows),
        scans=rows,
        ground_m=np.full(len(rows), ground_m),
        used=np.ones(len(points), bool),
        **attrs,
    )
    return of_scans, of_submaps


def poles(folder: Path, odom_T_scan: np.ndarray | None = None, **settings: object) -> Artifacts:
    """The artifacts of three scans half a metre apart, each a submap that sees one pole."""
    heights_m = np.arange(0.75, 3.0, 0.25)
    poles_m = POLES_M - ALONG[:, :2, 3]
    points = [
        np.column_stack([np.tile(pole_m, (len(heights_m), 1)), heights_m]) for pole_m in poles_m
    ]
    return artifacts(folder, points, ALONG, odom_T_scan, **settings)


def lit(images: np.ndarray) -> list[int]:
    """The number of bright pixels in the image of each submap that looks straight ahead."""
    return (images[:, 0] > 30).sum(axis=(1, 2)).tolist()
