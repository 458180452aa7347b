"""Finds the layout of a .bin of points, which has no header: bytes in; points, or their width, out.

Layouts differ in the width of a record, the bytes of a point. All but NCLT's begin with x, y, z as
32-bit floats. Their width is the one

1. that divides the size of the file,
2. with which the numbers at the places of x, y and z look like coordinates in metres,
3. with which z is distributed unlike x (a wrong width mixes all coordinates in each column),
4. and, if several are left, with which neighbours in the file lie nearest to each other.
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # loads a part of it when that is first used
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import step_lengths_m

NCLT_BYTES = 8
"""Bytes of NCLT's records: x, y, z as 16-bit integers, intensity, laser id."""
XYZ_BYTES = 12
"""Bytes of x, y, z as 32-bit floats."""
NAMES_BY_COMMONNESS = {
    16: "as KITTI's",
    20: "as nuScenes'",
    12: "x, y, z",
    22: "as HeLiPR's Velodyne's",
    26: "as HeLiPR's Ouster's",
}
"""Layouts that begin with x, y, z as 32-bit floats, by the bytes of a record; commonest first."""
MIN_POINTS = 50
"""With fewer points distributions are not compared: the commonest layout that fits is taken."""
WIDTHS = range(XYZ_BYTES, 65)
"""Widths that are tried."""
FARTHEST_M = 500.0
NEAREST_M = 1e-6
LIKELY_SHARE = 0.8
"""At least this share of the coordinates of points lies between NEAREST_M and FARTHEST_M, or is 0.

Of random bytes read as floats, one in nine does. Zeros count too, since a simulator's level ground
may be almost all 0.
"""
HEAD_BYTES = 2**20
"""The layout is found from so many bytes at the beginning of a file."""
LASERS = 32
"""Lasers of NCLT's sensor."""
NUMBERS_PER_POINT = (4, 3, 5, 6, 7, 8)
"""How many numbers a point may have in a .bin that holds all x first; the commonest first."""
MAX_SAMPLES = 5_000
"""So many numbers are enough to compare distributions: of more, only every n-th is used."""
MAX_KS_DISTANCE = 0.1
"""Many numbers of one distribution have a smaller Kolmogorov–Smirnov distance than this."""
SPACING_FACTOR = 1.2
"""Multiples of the right width skip points, so their spacing is larger by less than this factor."""


def points(data: bytes, path: Path, width: int | None = None) -> NDArray[np.float32]:
    """Points (n, 3) of a .bin whose records, `width` bytes each, begin with x, y, z.

    If `width` is None, it is found from the bytes. Raises LogError if they cannot be such records.
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
    records = np.frombuffer(data, np.uint8).reshape(-1, width)
    return records[:, :XYZ_BYTES].copy().view("<f4")


def point_bytes(data: bytes) -> int | None:
    """The width of a record in a .bin, certain or not; None where no width fits."""
    return width_of(data).nbytes


class Width(NamedTuple):
    """The width of a record."""

    nbytes: int | None
    """None where no width fits."""
    is_certain: bool
    """False for a guess among several widths."""


def width_of(data: bytes) -> Width:
    """The width of a record in a .bin, by the rules of this module."""
    if _is_nclt(data):
        return Width(NCLT_BYTES, is_certain=True)
    points_by_width = _possible_points(data)
    distinct_points_by_width = {
        width: xyz_m for width, xyz_m in points_by_width.items() if _heights_differ(xyz_m)
    }
    is_certain = bool(distinct_points_by_width) or len(points_by_width) < 2
    if not distinct_points_by_width and len(data) < MIN_POINTS * max(points_by_width, default=0):
        return Width(_commonest(list(points_by_width)), is_certain)
    candidates = distinct_points_by_width or points_by_width
    spacing_m = {width: _spacing_m(xyz_m) for width, xyz_m in candidates.items()}
    if not spacing_m:
        return Width(None, is_certain)
    # multiples of the right width have nearly its spacing: the smallest of them is right
    limit_m = SPACING_FACTOR * min(spacing_m.values())
    return Width(min(width for width in spacing_m if spacing_m[width] <= limit_m), is_certain)


def refuse_planar(data: bytes, path: Path) -> None:
    """Raise LogError for a .bin that holds all x first, then all y, then all z.

    The files of RobotCar's radar data set do. No width gives such a file distinct heights, and
    with any width all columns have one distribution.
    """
    if not data or len(data) % 4:
        return
    numbers = np.frombuffer(data, "<f4")
    points_by_width = _possible_points(data)
    if any(_heights_differ(xyz_m) for xyz_m in points_by_width.values()):
        return
    for width in points_by_width:
        if width % 4 == 0 and not _columns_are_similar(numbers.reshape(-1, width // 4)):
            return
    for column_count in NUMBERS_PER_POINT:
        if len(numbers) % column_count:
            continue
        xyz_m = numbers.reshape(column_count, -1)[:3].T
        if _may_be_points(xyz_m) and _heights_differ(xyz_m):
            remedy = (
                f"with N numbers a point, {column_count} perhaps, `numpy.fromfile(FILE, "
                "'<f4').reshape(N, -1).T.tofile(FILE)`"
            )
            raise LogError(
                f"{path}: holds all x, then all y, then all z; {remedy} puts point after point"
            )


def _is_nclt(data: bytes) -> bool:
    """Whether the bytes are NCLT's records of four words: coordinates over 0, small laser ids."""
    head_bytes = min(len(data), HEAD_BYTES) // NCLT_BYTES * NCLT_BYTES
    words = np.frombuffer(data[:head_bytes], "<u2").reshape(-1, 4)
    if len(data) % NCLT_BYTES or not len(words):
        return False
    return bool((words[:, 3] >> 8).max() < LASERS and (words[:, :3] > 0).all())


def _possible_points(data: bytes) -> dict[int, NDArray[np.float32]]:
    """The first points (n, 3) of a .bin, for each width that makes them look like points."""
    points_by_width: dict[int, NDArray[np.float32]] = {}
    for width in WIDTHS:
        if len(data) % width or not data:
            continue
        head_bytes = max(HEAD_BYTES // width, 1) * width
        records = np.frombuffer(data[:head_bytes], np.uint8).reshape(-1, width)
        xyz_m = records[:, :XYZ_BYTES].copy().view("<f4")
        if _may_be_points(xyz_m):
            points_by_width[width] = xyz_m
    return points_by_width


def _may_be_points(xyz_m: NDArray[np.float32]) -> bool:
    """Whether numbers (n, 3) look like the coordinates of points in metres."""
    magnitudes_m = np.abs(xyz_m)
    with np.errstate(invalid="ignore"):
        is_near = magnitudes_m < FARTHEST_M
        is_likely = is_near & ((magnitudes_m > NEAREST_M) | (magnitudes_m == 0))
    columns_differ = all((before != after).any() for before, after in pairwise(xyz_m.T))
    is_varied = len(xyz_m) < MIN_POINTS or columns_differ
    return bool(is_likely.mean() > LIKELY_SHARE and (xyz_m != 0).any() and is_varied)


def _heights_differ(xyz_m: NDArray[np.float32]) -> bool:
    """Whether the z of points (n, 3) are distributed unlike their x, as in any real place."""
    finite_points = xyz_m[np.isfinite(xyz_m).all(axis=1)]
    return _distributions_differ(finite_points[:, 0], finite_points[:, 2])


def _columns_are_similar(rows: NDArray[np.float32]) -> bool:
    """Whether all columns of records (n, column) have the same distribution."""
    finite_rows = rows[np.isfinite(rows).all(axis=1)]
    first_column = finite_rows[:, 0]
    return not any(_distributions_differ(first_column, column) for column in finite_rows.T[1:])


def _distributions_differ(
    first_sample: NDArray[np.float32], second_sample: NDArray[np.float32]
) -> bool:
    """Whether two samples (n,) come from two distributions; False for fewer than MIN_POINTS."""
    if len(first_sample) < MIN_POINTS:
        return False
    # An odd stride meets all lasers of a sensor: an even number of them, whose points alternate.
    stride = len(first_sample) // MAX_SAMPLES | 1
    first_sample = first_sample[::stride]
    second_sample = second_sample[::stride]
    distance = scipy.stats.ks_2samp(first_sample, second_sample, method="asymp").statistic
    # small samples of one distribution differ by chance, about as the root of 2 / their size
    distance_by_chance = 1.5 * np.sqrt(2 / len(first_sample))
    return bool(distance > MAX_KS_DISTANCE + distance_by_chance)


def _commonest(widths: list[int]) -> int | None:
    """The commonest of some widths; if none of them is common, the smallest."""
    for width in NAMES_BY_COMMONNESS:
        if width in widths:
            return width
    return min(widths, default=None)


def _spacing_m(xyz_m: NDArray[np.float32]) -> float:
    """Median distance in metres between neighbours in the file; inf for fewer than two points."""
    finite_points = xyz_m[np.isfinite(xyz_m).all(axis=1)].astype(np.float64)
    if len(finite_points) < 2:
        return np.inf
    return float(np.median(step_lengths_m(finite_points)))
