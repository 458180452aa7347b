"""Reads PCD files of the Point Cloud Library, version 0.7: ascii, binary and binary_compressed.

A header of text lines (FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, in any order, DATA last),
then the points: as lines of numbers, as little-endian records, or as one LZF block with the first
field of all points, then the second field, and so on. VIEWPOINT is ignored: the yaml of the data
set says where the sensor sits.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import LogError

HEADER_BYTES = 65_536
"""Limit for the header, which usually has a few hundred bytes.

A file without a DATA line before it is not a PCD.
"""
EXPANSION = 88
"""Largest expansion of LZF: three bytes encode at most 264."""
AXES = ("x", "y", "z")
KINDS = {"F": "f", "I": "i", "U": "u"}


@dataclass(frozen=True)
class Header:
    """The header of a PCD file."""

    fields: tuple[str, ...]
    types: tuple[str, ...]
    """The type of each field as numpy names it, such as <f4."""
    counts: tuple[int, ...]
    points: int
    data: str
    end: int
    """Index of the first byte after the header."""

    def axes(self) -> list[int]:
        return [self.fields.index(axis) for axis in AXES]

    def widths(self) -> list[int]:
        """Bytes of each field in a record."""
        return [
            np.dtype(kind).itemsize * count
            for kind, count in zip(self.types, self.counts, strict=True)
        ]


def decode(data: bytes, path: Path, largest: int) -> NDArray[np.float64]:
    """Points (n, 3) from the bytes of a PCD, in its frame and unit, NaN where the file has NaN.

    Raises LogError, which names `path`, for a file that is not PCD 0.7, is cut short, or would
    unpack to more than `largest` bytes.
    """
    header = parse(data, path)
    body = memoryview(data)[header.end :]
    if header.data == "ascii":
        return _ascii(header, bytes(body), path)
    if header.data == "binary":
        _expect(path, header, len(body))
        return _columns(header, body, interleaved=True)
    if len(body) < 8:
        raise LogError(f"{path}: no sizes after 'DATA binary_compressed'; the file is cut short")
    packed, whole = (int(size) for size in np.frombuffer(body[:8], "<u4"))
    _expect(path, header, whole)
    if packed > len(body) - 8 or any(body[8 + packed :]):  # some writers fill a page with zeros
        raise LogError(
            f"{path}: its block of {packed} compressed bytes is {len(body) - 8} bytes long; the "
            "file is damaged"
        )
    if whole > min(EXPANSION * packed, largest):
        raise LogError(
            f"{path}: claims that {packed} compressed bytes hold {whole}; the file is damaged"
        )
    unpacked = np.empty(whole, np.uint8)
    if not _lzf(np.frombuffer(body[8 : 8 + packed], np.uint8), unpacked):
        raise LogError(f"{path}: its compressed block is damaged")
    return _columns(header, unpacked, interleaved=False)


def encode(points_m: NDArray[np.floating]) -> bytes:
    """A binary PCD of points (n, 3), as 32-bit floats."""
    count = len(points_m)
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    return header.encode() + np.ascontiguousarray(points_m, "<f4").tobytes()


def parse(data: bytes, path: Path) -> Header:
    """The header from the bytes of a file; raises LogError naming the wrong line."""
    entries: dict[str, list[str]] = {}
    end = 0
    while "DATA" not in entries:
        line_end = data.find(b"\n", end, HEADER_BYTES)
        if line_end < 0:
            raise LogError(
                f"{path}: no PCD file: its header has no line 'DATA ascii|binary|binary_compressed'"
            )
        words = data[end:line_end].decode("ascii", "replace").split("#")[0].split()
        end = line_end + 1
        if words:
            entries[words[0]] = words[1:]
    if entries.get("VERSION", ["0.7"])[-1:] not in (["0.7"], [".7"]):
        raise LogError(
            f"{path}: PCD version {' '.join(entries['VERSION'])}; expected 0.7: save it anew"
        )
    fields = tuple(entries.get("FIELDS", []))
    sizes = entries.get("SIZE", [])
    kinds = entries.get("TYPE", [])
    counts = _numbers(path, "COUNT", entries.get("COUNT", ["1"] * len(fields)))
    if not len(fields) == len(sizes) == len(kinds) == len(counts):
        field_counts = f"{len(fields)}, {len(sizes)}, {len(kinds)} and {len(counts)}"
        raise LogError(
            f"{path}: FIELDS, SIZE, TYPE and COUNT are of {field_counts} fields; the header is "
            "damaged"
        )
    types = tuple(_type(path, kind, size) for kind, size in zip(kinds, sizes, strict=True))
    if any(fields.count(axis) != 1 or counts[fields.index(axis)] != 1 for axis in AXES):
        raise LogError(f"{path}: its fields are {' '.join(fields)}; expected x, y and z, once each")
    if (
        "POINTS" in entries or not {"WIDTH", "HEIGHT"} <= entries.keys()
    ):  # it says again what the two say, which some leave at 0
        points = _number(path, "POINTS", entries)
    else:
        points = _number(path, "WIDTH", entries) * _number(path, "HEIGHT", entries)
    form = " ".join(entries["DATA"])
    if form not in ("ascii", "binary", "binary_compressed"):
        raise LogError(f"{path}: DATA {form}; expected ascii, binary or binary_compressed")
    return Header(fields, types, tuple(counts), points, form, end)


def _type(path: Path, kind: str, size: str) -> str:
    if kind not in KINDS or size not in (("4", "8") if kind == "F" else ("1", "2", "4", "8")):
        raise LogError(
            f"{path}: a field of TYPE {kind} and SIZE {size}; expected F of 4 or 8, I or U of 1, "
            "2, 4 or 8"
        )
    return f"<{KINDS[kind]}{size}"


def _number(path: Path, key: str, entries: dict[str, list[str]]) -> int:
    words = entries.get(key, [])
    if len(words) != 1:
        raise LogError(f"{path}: its header has no line '{key} NUMBER'")
    return _numbers(path, key, words)[0]


def _numbers(path: Path, key: str, words: list[str]) -> list[int]:
    if not all(word.isdecimal() and word.isascii() and len(word) < 16 for word in words):
        raise LogError(f"{path}: {key} {' '.join(words)[:60]}; expected whole numbers")
    return [int(word) for word in words]


def _expect(path: Path, header: Header, nbytes: int) -> None:
    """Raise LogError unless `nbytes` is the size of all points by the header.

    It does so before anything is allocated.
    """
    expected_bytes = sum(header.widths()) * header.points
    if nbytes != expected_bytes:
        raise LogError(
            f"{path}: {nbytes} bytes of points, {expected_bytes} for the {header.points} points of "
            "its header; it is damaged"
        )


def _ascii(header: Header, body: bytes, path: Path) -> NDArray[np.float64]:
    columns = np.cumsum([0, *header.counts])
    lines = [line for line in body.decode("ascii", "replace").splitlines() if line.strip()]
    if len(lines) != header.points:
        raise LogError(
            f"{path}: {len(lines)} lines of points for the {header.points} points of its header; "
            "it is damaged"
        )
    if not lines:
        return np.empty((0, 3))
    try:
        rows = np.loadtxt(lines, ndmin=2, comments=None)
    except ValueError as error:
        raise LogError(
            f"{path}: points are lines of {columns[-1]} numbers; {str(error).splitlines()[0]}"
        ) from None
    if rows.shape[1] != columns[-1]:
        raise LogError(f"{path}: a point has {rows.shape[1]} numbers, {columns[-1]} by its header")
    return rows[:, columns[header.axes()]]


def _columns(
    header: Header, data: memoryview | NDArray[np.uint8], interleaved: bool
) -> NDArray[np.float64]:
    """Points (n, 3) from records (`interleaved`) or from one column after the other."""
    widths = header.widths()
    points = header.points
    xyz = np.empty((points, 3))
    for axis, field in enumerate(header.axes() if points else []):
        offset = sum(widths[:field])
        start, step = (offset, sum(widths)) if interleaved else (offset * points, widths[field])
        xyz[:, axis] = np.ndarray(points, header.types[field], data, start, (step,))
    return xyz


@njit(cache=True, nogil=True, error_model="numpy")
def _lzf(packed: NDArray[np.uint8], unpacked: NDArray[np.uint8]) -> bool:
    """Unpack Marc Lehmann's LZF into all of `unpacked`; False where the block is damaged.

    A control byte c < 32 is followed by c + 1 literal bytes. Any other one is a copy of earlier
    output: its 3 upper bits (and one more byte where they are 7) are the length, its 5 lower bits
    and the next byte the distance back; copies may overlap.
    """
    at = np.int64(0)
    to = np.int64(0)
    while at < packed.shape[0]:
        control = np.int64(packed[at])
        at += 1
        if control < 32:
            count = control + 1
            if at + count > packed.shape[0] or to + count > unpacked.shape[0]:
                return False
            for i in range(count):
                unpacked[to + i] = packed[at + i]
            at += count
        else:
            count = (control >> 5) + 2
            if count == 9:
                if at >= packed.shape[0]:
                    return False
                count += np.int64(packed[at])
                at += 1
            if at >= packed.shape[0]:
                return False
            back = ((control & 31) << 8) + np.int64(packed[at]) + 1
            at += 1
            if back > to or to + count > unpacked.shape[0]:
                return False
            for i in range(count):
                unpacked[to + i] = unpacked[to + i - back]
        to += count
    return bool(to == unpacked.shape[0])
