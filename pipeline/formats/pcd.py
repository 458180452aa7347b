"""Reads PCD files of the Point Cloud Library, version 0.7, and writes binary ones.

A file begins with a header of text lines (FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, in any
order, and DATA last). The points follow in one of three forms, which DATA names:

    ascii                a line of numbers a point
    binary               a little-endian record a point
    binary_compressed    one LZF block: the first field of all points, then the second, and so on

VIEWPOINT is ignored: the yaml of the data set says where the sensor sits.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import LogError

HEADER_BYTES = 65_536
"""Limit for the header, which usually has a few hundred bytes.

A file without a DATA line within this limit is not a PCD.
"""
MAX_EXPANSION = 88
"""Largest expansion of LZF: three bytes encode at most 264."""
SIZES_BYTES = 8
"""Two 32-bit numbers before a compressed block: its packed and its unpacked bytes."""
AXES = ("x", "y", "z")
KINDS = {"F": "f", "I": "i", "U": "u"}
"""numpy's letter for a kind of number, by the letter of TYPE: float, signed, unsigned."""


@dataclass(frozen=True)
class Header:
    """The header of a PCD file."""

    fields: tuple[str, ...]
    """The name of each field."""
    types: tuple[str, ...]
    """The type of each field as numpy names it, such as <f4."""
    counts: tuple[int, ...]
    """How many numbers each field has."""
    points: int
    """Number of points."""
    data: str
    """The form of the points: ascii, binary or binary_compressed."""
    end: int
    """Index of the first byte after the header."""

    def axes(self) -> list[int]:
        """The indices of the fields x, y and z."""
        return [self.fields.index(axis) for axis in AXES]

    def field_bytes(self) -> list[int]:
        """The size of each field in a point's record, in bytes."""
        return [
            np.dtype(kind).itemsize * count
            for kind, count in zip(self.types, self.counts, strict=True)
        ]


def decode(data: bytes, path: Path, max_bytes: int) -> NDArray[np.float64]:
    """Points (n, 3) from the bytes of a PCD, in its frame and unit; NaN where the file has NaN.

    Raises LogError, which names `path`, for a file that is not PCD 0.7, is cut short, or would
    unpack to more than `max_bytes` bytes.
    """
    header = parse(data, path)
    body = memoryview(data)[header.end :]
    if header.data == "ascii":
        return _ascii(header, bytes(body), path)
    if header.data == "binary":
        _refuse_wrong_size(path, header, len(body))
        return _xyz(header, body, is_interleaved=True)
    return _xyz(header, _unpacked(path, header, body, max_bytes), is_interleaved=False)


def encode(points_m: NDArray[np.floating]) -> bytes:
    """A binary PCD of points (n, 3) in metres, stored as 32-bit floats."""
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
            f"{path}: PCD version {' '.join(entries['VERSION'])}; expected 0.7: save it again"
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
    # POINTS repeats WIDTH × HEIGHT, which some writers leave at 0
    if "POINTS" in entries or not {"WIDTH", "HEIGHT"} <= entries.keys():
        points = _number(path, "POINTS", entries)
    else:
        points = _number(path, "WIDTH", entries) * _number(path, "HEIGHT", entries)
    form = " ".join(entries["DATA"])
    if form not in ("ascii", "binary", "binary_compressed"):
        raise LogError(f"{path}: DATA {form}; expected ascii, binary or binary_compressed")
    return Header(
        fields=fields, types=types, counts=tuple(counts), points=points, data=form, end=end
    )


def _type(path: Path, kind: str, size: str) -> str:
    """A field's type as numpy names it, from the words of TYPE and SIZE."""
    sizes = ("4", "8") if kind == "F" else ("1", "2", "4", "8")
    if kind not in KINDS or size not in sizes:
        raise LogError(
            f"{path}: a field of TYPE {kind} and SIZE {size}; expected F of 4 or 8, I or U of 1, "
            "2, 4 or 8"
        )
    return f"<{KINDS[kind]}{size}"


def _number(path: Path, key: str, entries: dict[str, list[str]]) -> int:
    """The only number in the header's line `key`."""
    words = entries.get(key, [])
    if len(words) != 1:
        raise LogError(f"{path}: its header has no line '{key} NUMBER'")
    return _numbers(path, key, words)[0]


def _numbers(path: Path, key: str, words: list[str]) -> list[int]:
    """The words of the header's line `key` as whole numbers."""
    if not all(word.isdecimal() and word.isascii() and len(word) < 16 for word in words):
        raise LogError(f"{path}: {key} {' '.join(words)[:60]}; expected whole numbers")
    return [int(word) for word in words]


def _refuse_wrong_size(path: Path, header: Header, nbytes: int) -> None:
    """Raise LogError unless `nbytes` is the size of all points by the header."""
    expected_bytes = sum(header.field_bytes()) * header.points
    if nbytes != expected_bytes:
        raise LogError(
            f"{path}: {nbytes} bytes of points, {expected_bytes} for the {header.points} points of "
            "its header; it is damaged"
        )


def _ascii(header: Header, body: bytes, path: Path) -> NDArray[np.float64]:
    """Points (n, 3) from lines of numbers."""
    first_columns = np.cumsum([0, *header.counts])
    column_count = first_columns[-1]
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
            f"{path}: points are lines of {column_count} numbers; {str(error).splitlines()[0]}"
        ) from None
    if rows.shape[1] != column_count:
        raise LogError(f"{path}: a point has {rows.shape[1]} numbers, {column_count} by its header")
    return rows[:, first_columns[header.axes()]]


def _unpacked(path: Path, header: Header, body: memoryview, max_bytes: int) -> NDArray[np.uint8]:
    """The unpacked bytes of a compressed block."""
    if len(body) < SIZES_BYTES:
        raise LogError(f"{path}: no sizes after 'DATA binary_compressed'; the file is cut short")
    packed_bytes, unpacked_bytes = (int(size) for size in np.frombuffer(body[:SIZES_BYTES], "<u4"))
    _refuse_wrong_size(path, header, unpacked_bytes)
    block_end = SIZES_BYTES + packed_bytes
    # Some writers pad the file with zeros to a page, so zeros after the block are accepted.
    if block_end > len(body) or any(body[block_end:]):
        raise LogError(
            f"{path}: declares {packed_bytes} compressed bytes, {len(body) - SIZES_BYTES} follow; "
            "the file is damaged"
        )
    if unpacked_bytes > min(MAX_EXPANSION * packed_bytes, max_bytes):
        raise LogError(
            f"{path}: claims that {packed_bytes} compressed bytes hold {unpacked_bytes}; the file "
            "is damaged"
        )
    unpacked = np.empty(unpacked_bytes, np.uint8)
    if not _lzf(np.frombuffer(body[SIZES_BYTES:block_end], np.uint8), unpacked):
        raise LogError(f"{path}: its compressed block is damaged")
    return unpacked


def _xyz(
    header: Header, data: memoryview | NDArray[np.uint8], is_interleaved: bool
) -> NDArray[np.float64]:
    """Points (n, 3) from data with the fields of a point together (interleaved), or apart."""
    points = header.points
    xyz = np.empty((points, 3))
    if not points:
        return xyz
    sizes = header.field_bytes()
    for axis, field in enumerate(header.axes()):
        offset = sum(sizes[:field])
        start = offset if is_interleaved else offset * points
        step = sum(sizes) if is_interleaved else sizes[field]
        xyz[:, axis] = np.ndarray(
            points, header.types[field], buffer=data, offset=start, strides=(step,)
        )
    return xyz


@njit(cache=True, nogil=True, error_model="numpy")
def _lzf(packed: NDArray[np.uint8], unpacked: NDArray[np.uint8]) -> bool:
    """Unpack a block of Marc Lehmann's LZF into all of `unpacked`; False if it is damaged."""
    # A control byte c < 32 is followed by c + 1 literal bytes. Any other control byte copies
    # earlier output: its 3 upper bits (and one more byte if they are 7) are the length, its 5 lower
    # bits and the next byte the distance back. Copies may overlap their own output.
    read_bytes = np.int64(0)
    written_bytes = np.int64(0)
    while read_bytes < packed.shape[0]:
        control = np.int64(packed[read_bytes])
        read_bytes += 1
        if control < 32:  # literal bytes follow
            length = control + 1
            if read_bytes + length > packed.shape[0] or written_bytes + length > unpacked.shape[0]:
                return False
            for i in range(length):
                unpacked[written_bytes + i] = packed[read_bytes + i]
            read_bytes += length
        else:
            length = (control >> 5) + 2
            if length == 9:  # the 3 upper bits are 7
                if read_bytes >= packed.shape[0]:
                    return False
                length += np.int64(packed[read_bytes])
                read_bytes += 1
            if read_bytes >= packed.shape[0]:
                return False
            distance = ((control & 31) << 8) + np.int64(packed[read_bytes]) + 1
            read_bytes += 1
            if distance > written_bytes or written_bytes + length > unpacked.shape[0]:
                return False
            for i in range(length):
                unpacked[written_bytes + i] = unpacked[written_bytes + i - distance]
        written_bytes += length
    return bool(written_bytes == unpacked.shape[0])
