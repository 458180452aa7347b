"""Reads PCD files of the Point Cloud Library, version 0.7, and writes binary ones.

A file begins with a header of text lines (FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS, in any
order, and DATA last). The points follow in one of three forms, which DATA names:

    ascii                a line of numbers a point
    binary               a little-endian record a point
    binary_compressed    one LZF block: the first field of all points, then the second, and so on

VIEWPOINT is ignored: the yaml of the data set says where the sensor sits.
"""

import io
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats import records
from pipeline.formats.records import AXES, HEADER_BYTES, Column, Summary

MOST_UNPACKED_BYTES = 2**31
"""Limit for the points of a compressed map, which are unpacked at once."""
MAX_EXPANSION = 88
"""Largest expansion of LZF: three bytes encode at most 264."""
SIZES_BYTES = 8
"""Two 32-bit numbers before a compressed block: its packed and its unpacked bytes."""
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

    def record_bytes(self) -> int:
        """The size of a point, in bytes."""
        return sum(self._field_bytes())

    def ascii_columns(self) -> list[int]:
        """The indices of x, y and z among the numbers of a line."""
        return [sum(self.counts[: self.fields.index(axis)]) for axis in AXES]

    def columns(self, is_interleaved: bool) -> list[Column]:
        """The numbers of x, y and z; a point's fields are together (interleaved), or apart."""
        sizes = self._field_bytes()
        columns = []
        for axis in AXES:
            field = self.fields.index(axis)
            offset = sum(sizes[:field])
            start = offset if is_interleaved else offset * self.points
            step = sum(sizes) if is_interleaved else sizes[field]
            columns.append(Column(self.types[field], start, step))
        return columns

    def _field_bytes(self) -> list[int]:
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
    blocks = list(_blocks(io.BytesIO(data), len(data), path, sys.maxsize, max_bytes))
    return blocks[0] if blocks else np.empty((0, 3))


def blocks(path: Path, most_points: int) -> Iterator[NDArray[np.float64]]:
    """The points of a PCD on disk in blocks (n, 3) of at most `most_points`, as of `decode`.

    One block is in memory at a time, of binary_compressed the whole file. Raises LogError like
    `decode`, for a damaged file maybe after some blocks.
    """
    with path.open("rb") as file:
        yield from _blocks(file, path.stat().st_size, path, most_points, MOST_UNPACKED_BYTES)


def summary(path: Path) -> Summary:
    """What the header of a PCD on disk says; raises LogError naming the wrong line."""
    with path.open("rb") as file:
        header = parse(file.read(HEADER_BYTES), path)
    return Summary(
        header.points,
        records.is_float32(header.columns(is_interleaved=True)),
        others=records.others(header.fields),
    )


def encode(points_m: NDArray[np.floating]) -> bytes:
    """A binary PCD of points (n, 3) in metres, stored as 32-bit floats."""
    return encode_header(len(points_m)) + np.ascontiguousarray(points_m, "<f4").tobytes()


def encode_header(count: int, comment: str = "", size: Literal[4, 8] = 4) -> bytes:
    """The header of a binary PCD, with a comment of one line of ASCII if it is not empty.

    `count` points of three little-endian floats of `size` bytes follow.
    """
    comment_line = f"# {comment}\n" if comment else ""
    return (
        f"{comment_line}VERSION 0.7\nFIELDS x y z\nSIZE {size} {size} {size}\nTYPE F F F\n"
        f"COUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {count}\nDATA binary\n"
    ).encode()


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
    records.refuse_other_fields(path, fields)
    if any(counts[fields.index(axis)] != 1 for axis in AXES):
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


def _blocks(
    file: BinaryIO, file_bytes: int, path: Path, most_points: int, max_bytes: int
) -> Iterator[NDArray[np.float64]]:
    """Blocks (n, 3) of the points of a file, which is read from its start."""
    header = parse(file.read(HEADER_BYTES), path)
    file.seek(header.end)
    if header.data == "ascii":
        rows = records.lines(file)
        yield from records.from_lines(
            rows, path, header.ascii_columns(), sum(header.counts), header.points, most_points
        )
        records.refuse_more_lines(rows, path, header.points)
    elif header.data == "binary":
        _refuse_wrong_size(path, header, file_bytes - header.end)
        columns = header.columns(is_interleaved=True)
        yield from records.from_records(file, path, columns, header.points, most_points)
    else:
        unpacked = _unpacked(path, header, memoryview(file.read()), max_bytes)
        columns = header.columns(is_interleaved=False)
        for first in range(0, header.points, most_points):
            block = np.empty((min(most_points, header.points - first), 3))
            records.fill(block, unpacked, columns, first)
            yield block


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
    expected_bytes = header.record_bytes() * header.points
    if nbytes != expected_bytes:
        raise LogError(
            f"{path}: {nbytes} bytes of points, {expected_bytes} for the {header.points} points of "
            "its header; it is damaged"
        )


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
    if unpacked_bytes > MAX_EXPANSION * packed_bytes:
        raise LogError(
            f"{path}: claims that {packed_bytes} compressed bytes hold {unpacked_bytes}; the file "
            "is damaged"
        )
    if unpacked_bytes > max_bytes:
        raise LogError(
            f"{path}: unpacks to {unpacked_bytes} bytes, at most {max_bytes} are; save it as "
            "DATA binary"
        )
    unpacked = np.empty(unpacked_bytes, np.uint8)
    if not _lzf(np.frombuffer(body[SIZES_BYTES:block_end], np.uint8), unpacked):
        raise LogError(f"{path}: its compressed block is damaged")
    return unpacked


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
