"""Decodes the files of a user's own robot: scans (.bin, .npy, .pcd) and TUM files of poses.

A row of a TUM file is a stamp in seconds, x y z in metres and a quaternion qx qy qz qw. Where a
file is something else, the error says what it may be and what to do.
"""

import io
import math
import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.errors import LogError
from pipeline.core.frames import LATEST_NS
from pipeline.formats import bin_layout, pcd

SCANS = (".bin", ".npy", ".pcd")
"""Suffixes of scan files."""
SCAN_FOLDERS = ("velodyne_sync", "velodyne", "scans", "points", "clouds")
"""Subfolders of a log that may hold its scan files."""
TIMES = "times.txt"
"""The file beside KITTI poses with the time of each row in seconds."""
LARGEST_BYTES = 2**28
"""Limit for the file of one scan, packed and unpacked: a larger one is damaged, or is a map."""
MAX_COLUMNS = 32
"""Limit for the columns of an array of points; one with more is transposed, or an image."""
NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""The function that reads the header of a .npy, by the version of the format."""
ADVICE_BY_LENGTH = {
    12: "12 numbers a row are KITTI's: reader.poses_format: kitti, with the seconds in times.txt",
    13: (
        "13 numbers a row are a stamp and a matrix of 3 rows and 4 columns: write its rotation as "
        "a quaternion"
    ),
}
"""What to do with rows that are no TUM poses, by the count of their numbers."""
NUMBER_AT_END = re.compile(r"(?<![\d.])\d{1,19}(?:\.\d{1,9})?$", re.ASCII)
UNIT_BY_DIGITS = {18: "ns", 15: "us", 12: "ms"}
"""The unit of a stamp since 1970, if it has at least so many digits before its point."""
UNIT_NS = {"s": 10**9, "us": 10**3, "ns": 1}
"""Nanoseconds of each unit in which `reader.stamps` may give scans' names."""


def points(data: bytes, path: Path, point_bytes: int | None = None) -> NDArray[np.float64]:
    """Points (n, 3) from the bytes of a scan file, in the file's frame and unit.

    Points that are not finite are included. The suffix of `path` is the format. `point_bytes` is
    the width of a record in a .bin; if it is None, it is found from the bytes. Raises LogError for
    a file of another format or one cut short, before more than LARGEST_BYTES are allocated.
    """
    if len(data) > LARGEST_BYTES:
        raise LogError(
            f"{path}: {len(data)} bytes are more than one scan has; is it a map? A .pcd, .ply, "
            ".las or .laz of a whole place becomes a site by `yearloc pack --map MAP -o MAP.site`"
        )
    with np.errstate(invalid="ignore"):  # numpy warns when a signalling NaN becomes a float64
        if path.suffix == ".pcd":
            return pcd.decode(data, path, LARGEST_BYTES)
        if path.suffix == ".npy":
            return _npy(data, path)
        return bin_layout.points(data, path, point_bytes).astype(np.float64)


def parse_stamp_ns(word: str, unit: str) -> int | None:
    """A stamp such as 1326652795.280148 in `unit` (s, us, ns), converted to nanoseconds exactly.

    None if the word is not a stamp.
    """
    try:
        stamp = Decimal(word) * UNIT_NS[unit]
    except ArithmeticError:
        return None
    is_stamp = stamp.is_finite() and abs(stamp) < LATEST_NS
    return round(stamp) if is_stamp else None


def stamp_at_end(stem: str) -> int | None:
    """The stamp in ns at the end of a file's name; None where it ends in no number.

    A number with a point or of up to 11 digits is seconds; a longer one is milli-, micro- or
    nanoseconds since 1970. So the number of a scan is taken as seconds.
    """
    match = NUMBER_AT_END.search(stem)
    if match is None:
        return None
    number = match[0]
    unit = "s" if "." in number else (_unit_by_digits(len(number)) or "s")
    return round(Decimal(number) * {**UNIT_NS, "ms": 10**6}[unit])


def format_tum_row(stamp_ns: int, world_T_body: NDArray[np.float64]) -> str:
    """A row of a TUM file: stamp in s, x y z in m, qx qy qz qw, of a pose (4, 4)."""
    turn = Rotation.from_matrix(world_T_body[:3, :3]).as_quat(canonical=True)
    numbers = " ".join(f"{value:.6f}" for value in (*world_T_body[:3, 3], *turn))
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {numbers}"


def parse_tum(path: Path, text: str) -> tuple[list[int], NDArray[np.float64]]:
    """Stamps (n,) in ns and rows (n, 7) of x, y, z (m), qx, qy, qz, qw from the text of a TUM file.

    Rows hold NaN where the pose is unknown. In the file, numbers are separated by blanks or commas,
    and comments start with #. Stamps are read as decimals, since a double would round them by
    100 ns. Raises LogError naming the wrong row.
    """
    lines = (line.split("#")[0].replace(",", " ").split() for line in text.splitlines())
    rows = [words for words in lines if words]
    stamps: list[int] = []
    numbers = np.empty((len(rows), 7))
    for row, words in enumerate(rows):
        stamp = parse_stamp_ns(words[0], "s")
        row_text = f"row {row + 1} is '{' '.join(words)[:60]}'"
        if len(words) != 8 or stamp is None:
            raise LogError(
                f"{path}: {row_text}; expected stamp x y z qx qy qz qw, in s and m{no_tum(words)}"
            )
        try:
            numbers[row] = [float(word) for word in words[1:]]
        except ValueError:
            raise LogError(f"{path}: {row_text}; expected eight numbers") from None
        stamps.append(stamp)
    return stamps, numbers


def refuse_array(path: Path, dtype: np.dtype[Any], shape: tuple[int, ...]) -> None:
    """Raise LogError for an array of type `dtype` and `shape` without points along its last axis.

    The error says what to do if the array may hold points along its first axis.
    """
    array_text = f"found {dtype}{shape}"
    if dtype.kind not in "fiu" or dtype.itemsize > 8 or len(shape) < 2:
        raise LogError(f"{path}: expected points (n, 3 or more) as numbers, {array_text}")
    if 3 <= shape[-1] <= MAX_COLUMNS:
        return
    if 3 <= shape[0] <= MAX_COLUMNS < shape[-1]:
        advice = f"save `numpy.moveaxis(array, 0, -1)`, if the {shape[0]} are x, y, z first"
        raise LogError(
            f"{path}: expected points (n, 3 or more), {array_text}: its columns are its points; "
            f"{advice}"
        )
    advice = "x, y and z are needed"
    if shape[-1] > 2:
        advice = "a range image has no x, y, z: save the points that it was made of"
    raise LogError(f"{path}: expected points (n, 3 or more) as numbers, {array_text}; {advice}")


def no_tum(words: Sequence[str]) -> str:
    """For an error: what a row that is no TUM pose may be, and what to do; empty if unknown."""
    if len(words) in ADVICE_BY_LENGTH:
        return f"; {ADVICE_BY_LENGTH[len(words)]}"
    unit = unit_of(words[0]) if len(words) == 8 else ""
    return f"; its stamp is in {unit}: divide the stamps to have seconds" if unit else ""


def unit_of(word: str) -> str:
    """The unit (ms, us, ns) of a stamp since 1970; empty for seconds, or if it is no stamp."""
    if not word.replace(".", "", 1).isdecimal():
        return ""
    return _unit_by_digits(len(word.partition(".")[0]))


def _unit_by_digits(digits: int) -> str:
    """The unit of a stamp since 1970 with so many digits before its point; empty for seconds."""
    for min_digits, unit in UNIT_BY_DIGITS.items():
        if digits >= min_digits:
            return unit
    return ""


def _npy(data: bytes, path: Path) -> NDArray[np.float64]:
    """Points (n, 3) from the bytes of a .npy; the points of a range image (row, column, 3) too."""
    file = io.BytesIO(data)
    try:
        read_header = NPY_HEADERS[np.lib.format.read_magic(file)]
        shape, is_fortran_order, dtype = read_header(file)
    except Exception as error:  # the header is a Python literal, whose parser may raise anything
        raise LogError(
            f"{path}: no whole .npy file ({type(error).__name__}); save it again"
        ) from None
    refuse_array(path, dtype, shape)
    body = memoryview(data)[file.tell() :]
    expected_bytes = math.prod(shape) * dtype.itemsize
    if len(body) != expected_bytes:
        raise LogError(
            f"{path}: {len(body)} bytes of points, {expected_bytes} for its shape {shape}; the "
            "file is damaged"
        )
    flat = np.frombuffer(body, dtype) if expected_bytes else np.empty(0)
    array = flat.reshape(shape, order="F" if is_fortran_order else "C")
    return array.reshape(-1, shape[-1])[:, :3].astype(np.float64)
