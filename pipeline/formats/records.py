"""The layout of a .bin of points, which says nothing about itself: found by its size, and by what its numbers would be."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError

NCLT_BYTES = 8
"""Of NCLT's records: x, y, z as 16-bit integers, intensity, laser id."""
NAMES = {16: "as KITTI's", 20: "as nuScenes'", 12: "x, y, z", 22: "as HeLiPR's Velodyne's", 26: "as HeLiPR's Ouster's"}
"""Layouts that begin with x, y, z as 32-bit floats, by the bytes of a record."""
FEW = 50
"""Points whose neighbours tell nothing: then the commonest layout that fits."""
WIDTHS = range(12, 65)
FARTHEST_M, LEAST_M = 500.0, 1e-6
HEAD_BYTES = 2**20
LASERS = 32  # of NCLT's sensor


def points(data: bytes, path: Path, width: int | None = None) -> NDArray[np.float32]:
    """Points (n, 3) of a .bin whose records, `width` bytes each, begin with x, y, z; raises LogError where they cannot."""
    width = width or point_bytes(data) or 0
    if width == NCLT_BYTES:
        raise LogError(f"{path}: scaled 16-bit integers as NCLT's; the dataset nclt reads them from velodyne_sync/UTIME.bin")
    if not width:
        raise LogError(f"{path}: {len(data)} bytes that are no points: neither NCLT's nor records of x, y, z as 32-bit floats")
    if len(data) % width:
        raise LogError(f"{path}: {len(data)} bytes are no whole number of {width}-byte points (reader.point_bytes)")
    return np.frombuffer(data, np.uint8).reshape(-1, width)[:, :12].copy().view("<f4")


def point_bytes(data: bytes) -> int | None:
    """Bytes of a point in a .bin whose points begin with x, y, z as 32-bit floats in metres; 8: NCLT's; None: none fits.

    Where several widths fit, neighbours in the file tell: they lie nearest to each other in the right one.
    """
    words = np.frombuffer(data[: min(len(data), HEAD_BYTES) // NCLT_BYTES * NCLT_BYTES], "<u2").reshape(-1, 4)
    if len(data) % NCLT_BYTES == 0 and len(words) and (words[:, 3] >> 8).max() < LASERS and (words[:, :3] > 0).all():
        return NCLT_BYTES
    apart = {width: _apart(xyz_m) for width in WIDTHS if (xyz_m := _points(data, width)) is not None}
    if len(data) < FEW * max(apart, default=0):
        return next((width for width in NAMES if width in apart), None) or next(iter(apart), None)
    likely = [width for width in apart if apart[width] <= 1.2 * min(apart.values())]  # two points on are not much farther
    return likely[0] if likely else None


def _points(data: bytes, width: int) -> NDArray[np.float32] | None:
    """The first points (n, 3) of records so wide, if they could be some."""
    if len(data) % width or not data:
        return None
    rows = np.frombuffer(data[: max(HEAD_BYTES // width, 1) * width], np.uint8).reshape(-1, width)
    xyz_m = rows[:, :12].copy().view("<f4")
    size_m = np.abs(xyz_m)
    with np.errstate(invalid="ignore"):
        likely = (size_m < FARTHEST_M) & ((size_m > LEAST_M) | (size_m == 0))
    varied = len(xyz_m) < FEW or all((a != b).any() for a, b in pairwise(xyz_m.T))
    return xyz_m if likely.mean() > 0.95 and (xyz_m != 0).any() and varied else None


def _apart(xyz_m: NDArray[np.float32]) -> float:
    """Median distance of neighbours in the file."""
    known = xyz_m[np.isfinite(xyz_m).all(axis=1)].astype(np.float64)
    return float(np.median(np.linalg.norm(np.diff(known, axis=0), axis=1))) if len(known) > 1 else np.inf
