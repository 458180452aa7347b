"""Scan files and pose files as robots of one's own leave them: .bin, .npy and .pcd scans, TUM and KITTI poses."""

import io
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import pcd

SCANS = (".bin", ".npy", ".pcd")
TIMES = "times.txt"
"""Beside KITTI poses: the seconds of each row."""
LARGEST_BYTES = 2**28
"""Of one scan's file, and of what it unpacks to: a larger one is damage, or a map."""
NPY_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
UNIT_NS = {"s": 10**9, "us": 10**3, "ns": 1}


def points(data: bytes, path: Path, columns: int) -> NDArray[np.float64]:
    """The x, y, z (n, 3) of a scan file's bytes, as they stand; its suffix says what it is, `columns` how wide a .bin's rows are.

    Raises LogError for what is no such file or is cut short, before more than 2²⁸ bytes are taken.
    """
    if len(data) > LARGEST_BYTES:
        raise LogError(f"{path}: {len(data)} bytes are more than one scan has; is it a map?")
    with np.errstate(invalid="ignore"):  # a signalling NaN tells of itself when it is widened
        if path.suffix == ".pcd":
            return pcd.decode(data, path, LARGEST_BYTES)
        return _npy(data, path) if path.suffix == ".npy" else _bin(data, path, columns)


def stamp_ns(word: str, unit: str) -> int | None:
    """A stamp such as 1326652795.280148 in `unit` (s, us, ns) as nanoseconds, exactly; None if it is none."""
    try:
        stamp = Decimal(word) * UNIT_NS[unit]
    except ArithmeticError:
        return None
    return round(stamp) if stamp.is_finite() and abs(stamp) < 2**62 else None


def tum(path: Path, text: str) -> tuple[list[int], NDArray[np.float64]]:
    """Stamps in ns and rows (n, 7) x, y, z, qx, qy, qz, qw of a TUM file: blanks or commas, # comments, NaN where unknown.

    Stamps are read as the decimals that they are: a double would round them by 100 ns. Raises LogError naming the row.
    """
    lines = (line.split("#")[0].replace(",", " ").split() for line in text.splitlines())
    rows = [words for words in lines if words]
    stamps: list[int] = []
    numbers = np.empty((len(rows), 7))
    for row, words in enumerate(rows):
        stamp = stamp_ns(words[0], "s")
        if len(words) != 8 or stamp is None:
            raise LogError(f"{path}: row {row + 1} is '{' '.join(words)[:60]}'; expected stamp x y z qx qy qz qw, in s and m")
        try:
            numbers[row] = [float(word) for word in words[1:]]
        except ValueError:
            raise LogError(f"{path}: row {row + 1} is '{' '.join(words)[:60]}'; expected eight numbers") from None
        stamps.append(stamp)
    return stamps, numbers


def _bin(data: bytes, path: Path, columns: int) -> NDArray[np.float64]:
    if len(data) % (4 * columns):
        raise LogError(f"{path}: {len(data)} bytes are no whole number of {4 * columns}-byte points (columns={columns})")
    return np.frombuffer(data, "<f4").reshape(-1, columns)[:, :3].astype(np.float64)


def _npy(data: bytes, path: Path) -> NDArray[np.float64]:
    file = io.BytesIO(data)
    try:
        read = NPY_HEADERS[np.lib.format.read_magic(file)]
        shape, by_columns, kind = read(file)
    except Exception as error:  # the header is a Python literal: whatever its parser raises
        raise LogError(f"{path}: no whole .npy file ({type(error).__name__}); save it anew") from None
    if len(shape) != 2 or shape[1] < 3 or kind.kind not in "fiu" or kind.itemsize > 8:
        raise LogError(f"{path}: expected points (n, 3 or more) as numbers, found {kind}{shape}")
    body, wanted = memoryview(data)[file.tell() :], shape[0] * shape[1] * kind.itemsize
    if len(body) != wanted:
        raise LogError(f"{path}: {len(body)} bytes of points, {wanted} for its shape {shape}; the file is damaged")
    flat = np.frombuffer(body, kind) if wanted else np.empty(0)
    return flat.reshape(shape, order="F" if by_columns else "C")[:, :3].astype(np.float64)
