"""Reads the vertices of PLY files, version 1.0, and writes binary ones.

A file begins with a header of text lines: `ply`, the format, then each element (`element vertex
1000`) with its properties (`property float x`, or `property list uchar int vertex_indices`), and
`end_header`. The elements follow in that order: as a line of numbers each, or as binary records,
in which a list is its length and then its values.

Of the element vertex the properties x, y and z are read. All else is skipped.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats import records
from pipeline.formats.records import AXES, HEADER_BYTES, Column, Summary

ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""numpy's sign for the order of bytes, by the name of a format."""
NUMBERS = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
"""The type of a number as numpy names it, by its name in a header."""
VERTEX = "vertex"
SURFACES = ("face", "tristrips")
"""Elements that only a mesh has."""


@dataclass(frozen=True)
class Property:
    """A property of an element: a number, or a list of numbers."""

    name: str
    dtype: str
    """The type of its numbers as numpy names it."""
    length_dtype: str | None
    """The type of a list's length; None for a single number."""


@dataclass(frozen=True)
class Element:
    """A kind of record, such as vertex or face."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def has_lists(self) -> bool:
        """Whether its records differ in size."""
        return any(entry.length_dtype for entry in self.properties)

    def record_bytes(self) -> int:
        """The size of a record without lists."""
        return sum(np.dtype(entry.dtype).itemsize for entry in self.properties)


@dataclass(frozen=True)
class Header:
    """The header of a PLY file."""

    order: str
    """The order of bytes: < or >; empty for ascii."""
    elements: tuple[Element, ...]
    """The elements in the order of the file."""
    end: int
    """Index of the first byte after the header."""

    @property
    def vertex_index(self) -> int:
        """The index of the element vertex."""
        return [element.name for element in self.elements].index(VERTEX)

    @property
    def vertex(self) -> Element:
        """The element vertex."""
        return self.elements[self.vertex_index]

    def columns(self) -> list[Column]:
        """The numbers of x, y and z among the records of the vertices."""
        entries = self.vertex.properties
        names = [entry.name for entry in entries]
        ends = np.cumsum([0, *(np.dtype(entry.dtype).itemsize for entry in entries)]).tolist()
        return [
            Column(self.order + entries[names.index(axis)].dtype, ends[names.index(axis)], ends[-1])
            for axis in AXES
        ]


def blocks(path: Path, most_points: int) -> Iterator[NDArray[np.float64]]:
    """The vertices of a PLY on disk in blocks (n, 3) of at most `most_points`.

    They are in the file's frame and unit; NaN where the file has NaN. One block is in memory at a
    time. Raises LogError, which names `path`, for a file that is not PLY 1.0 or is cut short, maybe
    after some blocks.
    """
    with path.open("rb") as file:
        header = parse(file.read(HEADER_BYTES), path)
        file.seek(header.end)
        if header.order:
            yield from _binary(file, path, header, most_points)
        else:
            yield from _ascii(file, path, header, most_points)


def summary(path: Path) -> Summary:
    """What the header of a PLY on disk says; raises LogError naming the wrong line."""
    with path.open("rb") as file:
        header = parse(file.read(HEADER_BYTES), path)
    faces = sum(element.count for element in header.elements if element.name in SURFACES)
    names = [entry.name for entry in header.vertex.properties]
    is_float32 = records.is_float32(header.columns())
    return Summary(header.vertex.count, is_float32, faces, records.others(names))


def encode(points_m: NDArray[np.floating]) -> bytes:
    """A binary little-endian PLY of points (n, 3) in metres, stored as 32-bit floats."""
    return encode_header(len(points_m)) + np.ascontiguousarray(points_m, "<f4").tobytes()


def encode_header(count: int, comment: str = "", size: Literal[4, 8] = 4) -> bytes:
    """The header of a binary PLY, with a comment of one line of ASCII if it is not empty.

    `count` points of three little-endian floats of `size` bytes follow.
    """
    comment_line = f"comment {comment}\n" if comment else ""
    kind = "float" if size == 4 else "double"
    properties = "".join(f"property {kind} {axis}\n" for axis in AXES)
    return (
        f"ply\nformat binary_little_endian 1.0\n{comment_line}element vertex {count}\n"
        f"{properties}end_header\n"
    ).encode()


def parse(data: bytes, path: Path) -> Header:
    """The header from the bytes of a file; raises LogError naming the wrong line."""
    order = None
    elements: list[Element] = []
    rows = data.split(b"\n")
    if rows[0].strip() != b"ply":
        raise LogError(f"{path}: no PLY file: its first line is not 'ply'")
    end = len(rows[0]) + 1
    for row in rows[1:-1]:
        end += len(row) + 1
        line = row.decode("ascii", "replace").strip()
        match line.split():
            case ["comment" | "obj_info", *_] | []:
                pass
            case ["format", form, "1.0"] if form in ORDERS:
                order = ORDERS[form]
            case ["element", name, count] if count.isdecimal() and count.isascii():
                if len(count) > 15:
                    raise LogError(f"{path}: {count[:40]} records of {name}; it is damaged")
                elements.append(Element(name, int(count), ()))
            case ["property", "list", length, kind, name] if (
                elements and NUMBERS.get(length, "f")[0] != "f" and kind in NUMBERS
            ):
                _append(elements, Property(name, NUMBERS[kind], NUMBERS[length]))
            case ["property", kind, name] if elements and kind in NUMBERS:
                _append(elements, Property(name, NUMBERS[kind], None))
            case ["end_header"]:
                if order is None:
                    raise LogError(f"{path}: its header has no line 'format FORM 1.0'")
                header = Header(order, tuple(elements), end)
                _refuse_other_vertices(path, header)
                return header
            case _:
                raise LogError(
                    f"{path}: a line '{line[:60]}' in its header; expected PLY 1.0: save it again"
                )
    raise LogError(f"{path}: no PLY file: its header has no line 'end_header'")


def _append(elements: list[Element], entry: Property) -> None:
    """Add a property to the last element."""
    last = elements[-1]
    elements[-1] = Element(last.name, last.count, (*last.properties, entry))


def _refuse_other_vertices(path: Path, header: Header) -> None:
    """Raise LogError unless each vertex has x, y and z, and records of one size."""
    names = [element.name for element in header.elements]
    if names.count(VERTEX) != 1:
        raise LogError(f"{path}: its elements are {' '.join(names)}; expected vertex, once")
    entries = header.vertex.properties
    records.refuse_other_fields(path, [entry.name for entry in entries])
    lists = [entry.name for entry in entries if entry.length_dtype]
    if lists:
        raise LogError(
            f"{path}: each vertex has a list, {lists[0]}; save it again with x, y and z alone"
        )


def _ascii(
    file: BinaryIO, path: Path, header: Header, most_points: int
) -> Iterator[NDArray[np.float64]]:
    """Blocks of the vertices from lines of numbers."""
    rows = records.lines(file)
    before = sum(element.count for element in header.elements[: header.vertex_index])
    for _ in zip(range(before), rows, strict=False):  # range is asked first, and takes no line
        pass
    names = [entry.name for entry in header.vertex.properties]
    columns = [names.index(axis) for axis in AXES]
    count = header.vertex.count
    yield from records.from_lines(rows, path, columns, len(names), count, most_points)
    after = sum(element.count for element in header.elements[header.vertex_index + 1 :])
    found = sum(1 for _ in rows)
    if found != after:
        raise LogError(
            f"{path}: {found} lines after the points, {after} by its header; it is damaged"
        )


def _binary(
    file: BinaryIO, path: Path, header: Header, most_points: int
) -> Iterator[NDArray[np.float64]]:
    """Blocks of the vertices from binary records."""
    file_bytes = path.stat().st_size
    for element in header.elements[: header.vertex_index]:
        if element.has_lists:
            _skip_lists(file, path, header.order, element, file_bytes)
        else:
            file.seek(element.count * element.record_bytes(), 1)
    following = header.elements[header.vertex_index :]
    expected_bytes = sum(
        element.count * element.record_bytes() for element in following if not element.has_lists
    )
    found_bytes = file_bytes - file.tell()
    has_lists = any(element.has_lists and element.count for element in following)
    if found_bytes < expected_bytes or (found_bytes > expected_bytes and not has_lists):
        raise LogError(
            f"{path}: {found_bytes} bytes of points, {expected_bytes} for the "
            f"{header.vertex.count} points of its header; it is damaged"
        )
    columns = header.columns()
    yield from records.from_records(file, path, columns, header.vertex.count, most_points)


def _skip_lists(file: BinaryIO, path: Path, order: str, element: Element, file_bytes: int) -> None:
    """Move behind the records of an element with lists, whose lengths are in the file."""
    for _ in range(element.count):
        for entry in element.properties:
            length = 1
            if entry.length_dtype:
                word = file.read(np.dtype(entry.length_dtype).itemsize)
                if len(word) < np.dtype(entry.length_dtype).itemsize:
                    raise LogError(
                        f"{path}: it ends among its {element.name} records; it is damaged"
                    )
                length = int(np.frombuffer(word, order + entry.length_dtype)[0])
            if length < 0:
                raise LogError(f"{path}: a list of {element.name} has the length {length}")
            file.seek(length * np.dtype(entry.dtype).itemsize, 1)
        if file.tell() > file_bytes:
            raise LogError(f"{path}: it ends among its {element.name} records; it is damaged")
