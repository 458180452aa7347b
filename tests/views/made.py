"""Makes artifacts of scans and submaps as the stages write them, small enough to tell by hand what
their views show.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.frames import pose
from pipeline.mapping.octree import Octree
from pipeline.views.birdview import BirdView

Artifacts = tuple[store.Artifact, store.Artifact]

BIRDVIEW = BirdView(
    octree=Octree(edge_m=16.0, depth=5, motion="none"), headings=8, side_px=16, jitter_m=0.0
)
"""Bird-views of 16 m, in which a leaf is half a metre and a pixel is a metre."""
POLES_M = np.array([[4.25, 0.25], [-0.25, 3.25], [0.25, -5.25]])
"""Poles in the world: ahead, to the left and to the right of where the robot starts. Scan i sees
only pole i."""
SUITED = {"azimuth_deg": 360.0, "ground_m": 0.0, "highest_m": 9.0}
"""The `appearance` of submaps that suit every view."""
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
    with store.draft(
        folder / "scans.zarr", schemas.Scans, grain_m=0.005, skipped={}, clipped=0
    ) as draft:
        draft.put("points", np.rint(np.concatenate(points) / 0.005).astype(np.int16))
        draft.put("offsets", np.concatenate([[0], np.cumsum([len(cloud) for cloud in points])]))
        draft.put("stamps_ns", stamps)
        draft.put("world_T_scan", world_T_scan)
        draft.put("odom_T_scan", world_T_scan if odom_T_scan is None else odom_T_scan)
        nothing_said = np.full((len(points), 2), np.nan)
        draft.put("odom_variance", nothing_said if odom_variance is None else odom_variance)
    attrs = {"layout": "world_T_scan", "left_out": {}, "appearance": SUITED} | attrs
    with store.draft(folder / "submaps.zarr", schemas.Submaps, **attrs) as draft:
        draft.put("first", np.array(first or rows))
        draft.put("scans", rows)
        draft.put("stamps_ns", stamps[rows])
        draft.put("ground_m", np.full(len(rows), ground_m))
        draft.put("used", np.ones(len(points), bool))
        draft.put("world_T_anchor", world_T_scan[rows])
    return store.read(folder / "scans.zarr", schemas.Scans), store.read(
        folder / "submaps.zarr", schemas.Submaps
    )


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
