"""Tests PointCloud2 messages: made by hand, drawn at random, damaged, and one of a real sensor."""

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD, typestore
from pipeline.formats.pointcloud2 import DATATYPES, decode
from tests.readers.damage import one_line

NAN = float("nan")
INF = float("inf")


@dataclass(frozen=True)
class Message:
    """A PointCloud2; by default its points are of 12 bytes, in one row."""

    data: NDArray[np.uint8]
    width: int
    fields: tuple[SimpleNamespace, ...]
    height: int = 1
    is_bigendian: bool = False
    point_step: int = 12
    row_step: int = 12


def field(name: str, offset: int, datatype: int = 7, count: int = 1) -> SimpleNamespace:
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


XYZ = (field("x", 0), field("y", 4), field("z", 8))
"""x, y, z as float32, one after the other."""
DOUBLES = (field("x", 0, 8), field("y", 8, 8), field("z", 16, 8))


def message(
    data: bytes, width: int, fields: tuple[SimpleNamespace, ...] = XYZ, **sizes: int | bool
) -> Message:
    made = Message(np.frombuffer(data, np.uint8), width, fields)
    return replace(made, **({"row_step": width * int(sizes.get("point_step", 12))} | sizes))


SIX = struct.pack("<6f", 1, 2, 3, 4, 5, 6)
PADDED = struct.pack("<3f3x3f", 1, 2, 3, 4, 5, 6)


@pytest.mark.parametrize(
    "message",
    [
        message(SIX, 2),
        message(struct.pack(">6f", 1, 2, 3, 4, 5, 6), 2, is_bigendian=True),
        message(PADDED, 1, height=2, row_step=15),
        message(SIX, 1, height=2, row_step=24),
        message(SIX, 1, height=2, row_step=0),
        message(SIX, 2, height=0, row_step=24),
        message(SIX, 2, row_step=0),
    ],
    ids=[
        "plain",
        "big-endian",
        "no padding behind the last row",
        "the size of all as row_step",
        "no row_step",
        "no height",
        "one row without row_step",
    ],
)
def test_two_points_of_any_layout_are_read(message: Message) -> None:
    found = decode(message)
    np.testing.assert_array_equal(found, [[1, 2, 3], [4, 5, 6]])
    assert found.dtype == (np.float64 if message.is_bigendian else np.float32)


def test_points_that_are_not_finite_or_beyond_float32_are_left_out() -> None:
    odd = struct.pack("<12f", 1, 2, 3, NAN, 0, 0, 0, INF, 0, 0, 0, -INF)
    np.testing.assert_array_equal(decode(message(odd, 4)), [[1, 2, 3]])
    large = message(struct.pack("<6d", 1e300, 0, 0, 1, 2, 3), 2, DOUBLES, point_step=24)
    np.testing.assert_array_equal(decode(large), [[1, 2, 3]])


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (message(bytes(12), 2), "needs 24 bytes, has 12"),
        (message(bytes(23), 1, height=2, row_step=13), "needs 25 bytes, has 23"),
        (message(bytes(24), 2, height=2, row_step=12), "rows of 12 bytes for 2 points of 12"),
        (message(bytes(12), 1, point_step=11), "field 'z' ends at byte 12 of points of 11 bytes"),
        (message(bytes(12), 1, (*XYZ, field("ring", 11, 4, 3))), "field 'ring' ends at byte 17"),
        (message(bytes(12), 1, XYZ[:2]), "without a field z: its fields are 'x', 'y'"),
        (message(bytes(12), 1, (*XYZ[:2], field("z", 8, 12))), "field z has the datatype 12"),
        (message(bytes(12), 0), "1 × 0 points"),
        (message(bytes(12), 2**32 - 1, height=2**32 - 1, row_step=2**32 - 1), "rows of 4294967295"),
        (message(bytes(12), 2**32 - 1), "needs 51539607540 bytes, has 12"),
    ],
)
def test_sizes_that_do_not_fit_raise_an_error_of_one_line(made: Message, says: str) -> None:
    with one_line(LogError, says):
        decode(made)


@st.composite
def layouts(draw: st.DrawFn) -> tuple[Message, NDArray[np.float64]]:
    """A message with its fields in any order, with gaps, of any type, count and byte order, and
    with padded rows; and the points in it."""
    big = draw(st.booleans())
    offset = 0
    fields = []
    formats = {}
    for name in draw(st.permutations(["x", "y", "z", "intensity", "ring"])):
        datatype = draw(st.sampled_from(sorted(DATATYPES)))
        count = draw(st.integers(1, 3))
        offset += draw(st.integers(0, 5))
        fields.append(field(name, offset, datatype, count))
        formats[name] = (np.dtype((">" if big else "<") + DATATYPES[datatype]), offset)
        offset += np.dtype(DATATYPES[datatype]).itemsize * count
    step = offset + draw(st.integers(0, 5))
    height = draw(st.integers(1, 3))
    width = draw(st.integers(1, 4))
    row = width * step + draw(st.integers(0, 7))
    data = np.frombuffer(
        draw(st.binary(min_size=height * row, max_size=height * row + 3)), np.uint8
    ).copy()
    points = np.zeros((height * width, 3))
    for i in range(len(points)):
        for axis, name in enumerate("xyz"):
            kind, at = formats[name]
            value = draw(st.integers(0, 100))
            start = i // width * row + i % width * step + at
            data[start : start + kind.itemsize] = np.frombuffer(
                np.array(value, kind).tobytes(), np.uint8
            )
            points[i, axis] = value
    return Message(data, width, tuple(fields), height, big, step, row), points


@given(layouts())
@settings(max_examples=200, derandomize=True)
def test_any_layout_is_read(laid: tuple[Message, NDArray[np.float64]]) -> None:
    made, points = laid
    np.testing.assert_array_equal(decode(made), points)


SIZES = st.one_of(st.integers(0, 40), st.sampled_from([2**31 - 1, 2**31, 2**32 - 1]))
NAMES = st.sampled_from(["x", "y", "z", "x\n", ""])
COUNTS = st.one_of(st.integers(0, 3), st.just(2**32 - 1))
FIELDS = st.one_of(
    st.just(XYZ), st.lists(st.builds(field, NAMES, SIZES, st.integers(0, 12), COUNTS), max_size=5)
)
DATA = st.binary(max_size=200).map(lambda data: np.frombuffer(data, np.uint8))
STEPS = st.one_of(st.just(12), SIZES)


@given(
    st.builds(
        Message, DATA, SIZES, FIELDS, st.one_of(st.just(1), SIZES), st.booleans(), STEPS, STEPS
    )
)
@settings(max_examples=200, derandomize=True)
def test_a_damaged_message_gives_finite_points_or_an_error_of_one_line(made: Message) -> None:
    try:
        found = decode(made)
    except LogError as error:
        line = str(error)
    else:
        assert np.isfinite(found).all()
        assert found.shape[1:] == (3,)
        assert len(found) <= made.height * made.width
        return
    assert "\n" not in line


def test_a_real_message_of_26_bytes_a_point(real: Path) -> None:
    data = (real / "bags/pointcloud2_cdr_message.bin").read_bytes()
    found = decode(typestore(2).deserialize_cdr(data, CLOUD))
    assert found.shape == (64_000, 3)
    assert int((found[:, 0] == 0).sum()) == 4_578
    start = data.find(found[:1].tobytes())
    np.testing.assert_array_equal(
        struct.unpack_from("<3f", data, start + 26 * 63_999), found[63_999]
    )
