"""Makes artifacts of scans, submaps and views as the stages write them, from the arrays of a
test."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pipeline.core import schemas, store
from pipeline.posing import targets

Kind = TypeVar("Kind", bound=store.Artifact)

GRAIN_M = 0.005
SUITED = {"azimuth_deg": 360.0, "ground_m": 0.0, "highest_m": 9.0}
"""The `appearance` of submaps that suit every view."""


def written(path: Path, kind: type[Kind], columns: Mapping[str, Any], **attrs: Any) -> Kind:
    """An artifact with these arrays and attributes."""
    with store.draft(path, kind, **attrs) as draft:
        for name, column in columns.items():
            draft.put(name, column)
    return store.read(path, kind)


def write_scans(
    path: Path,
    points: Sequence[np.ndarray],
    world_T_scan: np.ndarray,
    *,
    odom_T_scan: np.ndarray | None = None,
    odom_variance: np.ndarray | None = None,
    stamps_ns: np.ndarray | None = None,
) -> schemas.Scans:
    """Scans of points (n, 3) each; their odometry is the ground truth unless it is given."""
    count = len(points)
    columns = {
        "points": np.rint(np.concatenate([np.empty((0, 3)), *points]) / GRAIN_M).astype(np.int16),
        "offsets": np.cumsum([0, *map(len, points)]),
        "stamps_ns": np.arange(count) if stamps_ns is None else stamps_ns,
        "world_T_scan": world_T_scan,
        "odom_T_scan": world_T_scan if odom_T_scan is None else odom_T_scan,
        "odom_variance": np.full((count, 2), np.nan) if odom_variance is None else odom_variance,
    }
    return written(path, schemas.Scans, columns, grain_m=GRAIN_M, skipped={}, clipped=0)


def write_submaps(
    path: Path, world_T_anchor: np.ndarray, *, stamps_ns: np.ndarray | None = None, **changes: Any
) -> schemas.Submaps:
    """Submaps of a scan each; `changes` replace some of their other arrays and attributes."""
    rows = np.arange(len(world_T_anchor))
    columns = {
        "first": rows,
        "scans": rows,
        "ground_m": np.zeros(len(rows)),
        "used": np.ones(len(rows), bool),
    }
    attrs = {"layout": "world_T_scan", "left_out": {}, "appearance": SUITED} | {
        name: value for name, value in changes.items() if name not in columns
    }
    columns |= {name: value for name, value in changes.items() if name in columns}
    columns |= {"stamps_ns": rows if stamps_ns is None else stamps_ns}
    return written(path, schemas.Submaps, columns | {"world_T_anchor": world_T_anchor}, **attrs)


def write_map(path: Path, points: Sequence[np.ndarray], world_T_anchor: np.ndarray) -> schemas.Maps:
    """A map of these clouds (n, 3), each as seen from its anchor."""
    columns = {
        "points": np.rint(np.concatenate([np.empty((0, 3)), *points]) / targets.GRAIN_M).astype(
            np.int64
        ),
        "offsets": np.cumsum([0, *map(len, points)]),
        "world_T_anchor": world_T_anchor,
    }
    attrs = {"grain_m": targets.GRAIN_M, "voxel_m": 0.5, "range_m": 80.0, "single": True}
    return written(path, schemas.Maps, columns, **attrs)


def write_views(
    path: Path, kind: type[Kind], images: np.ndarray, world_T_anchor: np.ndarray, **attrs: Any
) -> Kind:
    """Views (n, …) of submaps with these poses."""
    stamps_ns = np.arange(len(images))
    columns = {"images": images, "stamps_ns": stamps_ns, "world_T_anchor": world_T_anchor}
    return written(path, kind, columns, **attrs)
