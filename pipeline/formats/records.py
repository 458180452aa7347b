"""The layout of a .bin of points, which says nothing about itself: found by its size, and by what
its numbers would be."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy  # loads a part of it when that is first used
from numpy.typing import NDArray

from pipeline.errors import LogError

NCLT_BYTES = 8
"""Of NCLT's records: x, y, z as 16-bit integers, intensity, laser id."""
NAMES = {
    16: "as KITTI's",
    20: "as nuScenes'",
    12: "x, y, z",
    22: "as HeLiPR's Velodyne's",
    26: "as HeLiPR's Ouster's",
}
"""Layouts that begin with x, y, z as 32-bit floats, by the bytes of a record."""
FEW = 50
"""Points whose neighbours tell nothing: then the commonest layout that fits."""
WIDTHS = range(12, 65)
FARTHEST_M = 500.0
LEAST_M = 1e-6
LIKELY = 0.8
"""So many of the numbers of points are; of bytes that are none, one in nine.

A simulator's level ground may be all but 0.
"""
HEAD_BYTES = 2**20
LASERS = 32  # of NCLT's sensor
COLUMNS = (4, 3, 5, 6, 7, 8)
"""Numbers of a point in a .bin that holds all x first, the commonest first."""
ENOUGH = 5_000
"""Numbers tell a distribution well enough."""
ALIKE = 0.1
"""Numbers of one distribution differ by less than this (Kolmogorov and Smirnov's distance), if they
are many."""


def points(data: bytes, path: Path, width: int | None = None) -> NDArray[np.float32]:
    """Points (n, 3) of a .bin whose records, `width` bytes each, begin with x, y, z; raises
    LogError where they cannot."""
    if not width:
        width, is_told = layout(data)
        if not is_told:
            refuse_planar(data, path)
    if width == NCLT_BYTES:
        raise LogError(
            f"{path}: scaled 16-bit integers as NCLT's; the dataset nclt reads them from "
            "velodyne_sync/UTIME.bin"
        )
    if not width:
        raise LogError(
            f"{path}: {len(data)} bytes that are no points: neither NCLT's nor records of x, y, z "
            "as 32-bit floats"
        )
    if len(data) % width:
        raise LogError(
            f"{path}: {len(data)} bytes are no whole number of {width}-byte points "
            "(reader.point_bytes)"
        )
    return np.frombuffer(data, np.uint8).reshape(-1, width)[:, :12].copy().view("<f4")


def point_bytes(data: bytes) -> int | None:
    """The first of `layout`."""
    return layout(data)[0]


def layout(data: bytes) -> tuple[int | None, bool]:
    """Bytes of a point in a .bin whose points begin with x, y, z as 32-bit floats in metres, and
    whether it is no guess.

    8 are NCLT's; None: no width fits. Where several do, the numbers tell: in the right one heights
    are spread unlike positions ahead, and neighbours in the file lie nearest to each other. Where
    they do not, it is the commonest that fits.
    """
    words = np.frombuffer(
        data[: min(len(data), HEAD_BYTES) // NCLT_BYTES * NCLT_BYTES], "<u2"
    ).reshape(-1, 4)
    if (
        len(data) % NCLT_BYTES == 0
        and len(words)
        and (words[:, 3] >> 8).max() < LASERS
        and (words[:, :3] > 0).all()
    ):
        return NCLT_BYTES, True
    fitting = _fitting(data)
    telling = {width: xyz_m for width, xyz_m in fitting.items() if _heights_differ(xyz_m)}
    if not telling and len(data) < FEW * max(fitting, default=0):
        commonest = next((width for width in NAMES if width in fitting), None) or next(
            iter(fitting), None
        )
        return commonest, len(fitting) < 2
    apart = {width: _apart(xyz_m) for width, xyz_m in (telling or fitting).items()}
    likely = [
        width for width in apart if apart[width] <= 1.2 * min(apart.values())
    ]  # two points on are not much farther
    return (likely[0] if likely else None), bool(telling) or len(fitting) < 2


def refuse_planar(data: bytes, path: Path) -> None:
    """Raise LogError for a .bin that holds all x first, then all y, then all z, as those of
    RobotCar's radar data set do."""
    if not data or len(data) % 4:
        return
    numbers = np.frombuffer(data, "<f4")
    fitting = _fitting(data)
    whole = (numbers.reshape(-1, width // 4) for width in fitting if width % 4 == 0)
    if any(map(_heights_differ, fitting.values())) or not all(map(_alike, whole)):
        return
    for columns in COLUMNS:
        if len(numbers) % columns:
            continue
        xyz_m = numbers.reshape(columns, -1)[:3].T
        if _may_be_points(xyz_m) and _heights_differ(xyz_m):
            turned = (
                f"with N numbers a point, {columns} perhaps, `numpy.fromfile(FILE, "
                "'<f4').reshape(N, -1).T.tofile(FILE)`"
            )
            raise LogError(
                f"{path}: holds all x, then all y, then all z; {turned} puts point after point"
            )


def _fitting(data: bytes) -> dict[int, NDArray[np.float32]]:
    """The first points (n, 3) of a .bin by each width of a record that fits."""
    return {width: xyz_m for width in WIDTHS if (xyz_m := _points(data, width)) is not None}


def _points(data: bytes, width: int) -> NDArray[np.float32] | None:
    """The first points (n, 3) of records so wide, if they could be some."""
    if len(data) % width or not data:
        return None
    rows = np.frombuffer(data[: max(HEAD_BYTES // width, 1) * width], np.uint8).reshape(-1, width)
    xyz_m = rows[:, :12].copy().view("<f4")
    return xyz_m if _may_be_points(xyz_m) else None


def _may_be_points(xyz_m: NDArray[np.float32]) -> bool:
    """Whether numbers (n, 3) are such as points have."""
    size_m = np.abs(xyz_m)
    with np.errstate(invalid="ignore"):
        likely = (size_m < FARTHEST_M) & ((size_m > LEAST_M) | (size_m == 0))
    varied = len(xyz_m) < FEW or all((a != b).any() for a, b in pairwise(xyz_m.T))
    return bool(likely.mean() > LIKELY and (xyz_m != 0).any() and varied)


def _alike(rows: NDArray[np.float32]) -> bool:
    """Whether all columns of records (n, column) have one distribution, as where they are not
    records: each holds all columns."""
    known = rows[np.isfinite(rows).all(axis=1)]
    return not any(_differ(known[:, 0], column) for column in known.T[1:])


def _heights_differ(xyz_m: NDArray[np.float32]) -> bool:
    """Whether the z of points (n, 3) are spread unlike their x, as in any place, and never where
    the numbers are mixed up."""
    known = xyz_m[np.isfinite(xyz_m).all(axis=1)]
    return _differ(known[:, 0], known[:, 2])


def _differ(a: NDArray[np.float32], b: NDArray[np.float32]) -> bool:
    """Whether as many numbers (n,) are of two distributions; of few it is not known."""
    if len(a) < FEW:
        return False
    every = (
        len(a) // ENOUGH | 1
    )  # odd, as the lasers of a sensor, which stand one after another, are an even number
    away = scipy.stats.ks_2samp(a[::every], b[::every], method="asymp").statistic
    return bool(away > ALIKE + 1.5 * np.sqrt(2 / len(a[::every])))


def _apart(xyz_m: NDArray[np.float32]) -> float:
    """Median distance of neighbours in the file."""
    known = xyz_m[np.isfinite(xyz_m).all(axis=1)].astype(np.float64)
    return (
        float(np.median(np.linalg.norm(np.diff(known, axis=0), axis=1)))
        if len(known) > 1
        else np.inf
    )
