"""Finds the layout of a .bin of points, which has no header: bytes in; points, or their width, out.

Layouts differ in the bytes of a point. The right one divides the size of the file, and its numbers
look like the coordinates of neighbouring points; those of a wrong one are mixed up.
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # loads a part of it when that is first used
from numpy.typing import NDArray

from pipeline.core.errors import LogError

NCLT_BYTES = 8
"""Of NCLT's records: x, y, z as 16-bit integers, intensity, laser id."""
NAMES_BY_COMMONNESS = {
    16: "as KITTI's",
    20: "as nuScenes'",
    12: "x, y, z",
    22: "as HeLiPR's Velodyne's",
    26: "as HeLiPR's Ouster's",
}
"""Layouts that begin with x, y, z as 32-bit floats, by the bytes of a record; commonest first."""
MIN_POINTS = 50
"""Fewer points tell no layout: the commonest one that fits is taken."""
WIDTHS = range(12, 65)
"""Bytes of a point that are tried."""
FARTHEST_M = 500.0
LEAST_M = 1e-6
LIKELY_SHARE = 0.8
"""At least this share of points' coordinates lies between LEAST_M and FARTHEST_M, or is 0.

Of random bytes read as floats, one in nine does. Zeros count too, since a simulator's level ground
may be almost all 0.
"""
HEAD_BYTES = 2**20
"""The beginning of a file, from which the layout is found."""
LASERS = 32
"""Of NCLT's sensor."""
NUMBERS_PER_POINT = (4, 3, 5, 6, 7, 8)
"""Numbers of a point in a .bin that holds all x first, the commonest first."""
MAX_SAMPLES = 5_000
"""This many numbers tell a distribution well enough: of more, only every n-th is compared."""
MAX_KS_DISTANCE = 0.1
"""Many numbers of one distribution have a smaller Kolmogorov–Smirnov distance than this."""


def points(data: bytes, path: Path, width: int | None = None) -> NDArray[np.float32]:
    """Points (n, 3) of a .bin whose records, `width` bytes each, begin with x, y, z.

    None: the width is found from the bytes. Raises LogError where they cannot be such records.
    """
    if not width:
        width, is_certain = width_of(data)
        if not is_certain:
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
    """Bytes of a point in a .bin, certain or not; None where no width fits."""
    return width_of(data).nbytes


class Width(NamedTuple):
    """The bytes of a point."""

    nbytes: int | None
    """None where no width fits."""
    is_certain: bool


def width_of(data: bytes) -> Width:
    """The bytes of a point in a .bin.

    8 of NCLT's; others begin with x, y, z as 32-bit floats in metres. Where several widths fit, the
    coordinates tell: in the right one heights are spread unlike positions ahead, and neighbours in
    the file lie nearest to each other. Where they do not tell, it is the commonest width.
    """
    words = np.frombuffer(
        data[: min(len(data), HEAD_BYTES) // NCLT_BYTES * NCLT_BYTES], "<u2"
    ).reshape(-1, 4)
    if (
        len(data) % NCLT_BYTES == 0
        and len(words)
        and (words[:, 3] >> 8).max() < LASERS  # its high byte is the laser
        and (words[:, :3] > 0).all()
    ):
        return Width(NCLT_BYTES, is_certain=True)
    points_by_width = _fitting(data)
    with_distinct_heights = {
        width: xyz_m for width, xyz_m in points_by_width.items() if _heights_differ(xyz_m)
    }
    if not with_distinct_heights and len(data) < MIN_POINTS * max(points_by_width, default=0):
        commonest = next(
            (width for width in NAMES_BY_COMMONNESS if width in points_by_width), None
        ) or next(iter(points_by_width), None)
        return Width(commonest, is_certain=len(points_by_width) < 2)
    spacing_m = {
        width: _spacing_m(xyz_m)
        for width, xyz_m in (with_distinct_heights or points_by_width).items()
    }
    # multiples of the right width give nearly the same spacing: the smallest of them is right
    likely_widths = [
        width for width in spacing_m if spacing_m[width] <= 1.2 * min(spacing_m.values())
    ]
    return Width(
        likely_widths[0] if likely_widths else None,
        is_certain=bool(with_distinct_heights) or len(points_by_width) < 2,
    )


def refuse_planar(data: bytes, path: Path) -> None:
    """Raise LogError for a .bin that holds all x first, then all y, then all z.

    Those of RobotCar's radar data set do.
    """
    if not data or len(data) % 4:
        return
    numbers = np.frombuffer(data, "<f4")
    points_by_width = _fitting(data)
    four_byte_records = (
        numbers.reshape(-1, width // 4) for width in points_by_width if width % 4 == 0
    )
    if any(map(_heights_differ, points_by_width.values())) or not all(
        map(_columns_alike, four_byte_records)
    ):
        return
    for columns in NUMBERS_PER_POINT:
        if len(numbers) % columns:
            continue
        xyz_m = numbers.reshape(columns, -1)[:3].T
        if _may_be_points(xyz_m) and _heights_differ(xyz_m):
            remedy = (
                f"with N numbers a point, {columns} perhaps, `numpy.fromfile(FILE, "
                "'<f4').reshape(N, -1).T.tofile(FILE)`"
            )
            raise LogError(
                f"{path}: holds all x, then all y, then all z; {remedy} puts point after point"
            )


def _fitting(data: bytes) -> dict[int, NDArray[np.float32]]:
    """The first points (n, 3) of a .bin by each width of a record that fits."""
    return {width: xyz_m for width in WIDTHS if (xyz_m := _points(data, width)) is not None}


def _points(data: bytes, width: int) -> NDArray[np.float32] | None:
    """The first points (n, 3) if records of `width` bytes look like coordinates, else None."""
    if len(data) % width or not data:
        return None
    records = np.frombuffer(data[: max(HEAD_BYTES // width, 1) * width], np.uint8).reshape(
        -1, width
    )
    xyz_m = records[:, :12].copy().view("<f4")
    return xyz_m if _may_be_points(xyz_m) else None


def _may_be_points(xyz_m: NDArray[np.float32]) -> bool:
    """Whether numbers (n, 3) look like the coordinates of points in metres."""
    size_m = np.abs(xyz_m)
    with np.errstate(invalid="ignore"):
        likely = (size_m < FARTHEST_M) & ((size_m > LEAST_M) | (size_m == 0))
    varied = len(xyz_m) < MIN_POINTS or all((a != b).any() for a, b in pairwise(xyz_m.T))
    return bool(likely.mean() > LIKELY_SHARE and (xyz_m != 0).any() and varied)


def _columns_alike(rows: NDArray[np.float32]) -> bool:
    """Whether all columns of records (n, column) have one distribution.

    So it is where they are not records, and each column mixes all coordinates.
    """
    finite_rows = rows[np.isfinite(rows).all(axis=1)]
    return not any(_differ(finite_rows[:, 0], column) for column in finite_rows.T[1:])


def _heights_differ(xyz_m: NDArray[np.float32]) -> bool:
    """Whether the z of points (n, 3) are distributed unlike their x.

    So they are in any place, and never where the numbers are mixed up.
    """
    finite_points = xyz_m[np.isfinite(xyz_m).all(axis=1)]
    return _differ(finite_points[:, 0], finite_points[:, 2])


def _differ(a: NDArray[np.float32], b: NDArray[np.float32]) -> bool:
    """Whether `a` (n,) and `b` (n,) are of two distributions; of fewer than MIN_POINTS, False."""
    if len(a) < MIN_POINTS:
        return False
    # An odd stride meets all lasers of a sensor, whose points alternate: they are an even number.
    stride = len(a) // MAX_SAMPLES | 1
    distance = scipy.stats.ks_2samp(a[::stride], b[::stride], method="asymp").statistic
    return bool(distance > MAX_KS_DISTANCE + 1.5 * np.sqrt(2 / len(a[::stride])))


def _spacing_m(xyz_m: NDArray[np.float32]) -> float:
    """Median distance in metres between neighbours in the file; inf for fewer than two points."""
    finite_points = xyz_m[np.isfinite(xyz_m).all(axis=1)].astype(np.float64)
    return (
        float(np.median(np.linalg.norm(np.diff(finite_points, axis=0), axis=1)))
        if len(finite_points) > 1
        else np.inf
    )
