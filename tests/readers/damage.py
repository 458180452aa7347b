"""Damages files as disks, cables, editors and other computers do, and checks what a reader makes of
them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from pipeline.core.errors import YearlocError
from pipeline.readers.log import Log, Reader

KINDS = (
    "cut",
    "flip",
    "flip",
    "words",
    "words",
    "rows",
    "number",
    "number",
    "endian",
    "stretch",
    "longer",
    "empty",
    "noise",
)
WORDS = [
    *(
        b"nan",
        b"-inf",
        b"inf",
        b"1e308",
        b"-1e308",
        b"1e18",
        b"1000000000000",
        b"9" * 40,
        b"9" * 400,
        b"1e-320",
        b"-1",
        b"0",
    ),
    *(b"", b"0.5", b"1 2", b"#", b'"', b"\xff", b"\0", b"0x10", b"1_0", b"INS_INACTIVE", b"31U"),
]
NUMBERS = [
    b"\xff" * 4,
    b"\xff\xff\xff\x7f",
    b"\0\0\0\x80",
    bytes(4),
    b"\0\0\xc0\x7f",
    b"\0\0\x80\xff",
    b"\xff" * 8,
    bytes(7) + b"\x40",
]
"""As little-endian words: counts of thousands of millions, and as floats NaN and −inf."""


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with one fault: some bytes, words or rows lost, changed, repeated or moved."""
    kind = draw(st.sampled_from(KINDS))
    start = draw(st.integers(0, max(len(data) - 1, 0)))
    if kind == "cut":
        return data[:start]
    if kind == "flip":
        flipped = bytearray(data)
        for bit in draw(st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=8)):
            flipped[bit // 8] ^= 1 << bit % 8
        return bytes(flipped)
    if kind == "words":
        pieces = re.split(rb"([,\s])", data)
        for _ in range(draw(st.integers(1, 3))):
            pieces[2 * draw(st.integers(0, len(pieces) // 2))] = draw(st.sampled_from(WORDS))
        return b"".join(pieces)
    if kind == "rows":
        rows = data.split(b"\n")
        at, other = (draw(st.integers(0, len(rows) - 1)) for _ in range(2))
        changed = draw(st.sampled_from([[], rows[at : at + 1] * 2, rows[other : other + 1]]))
        return b"\n".join(rows[:at] + changed + rows[at + 1 :])
    if kind == "number":
        number = draw(st.sampled_from(NUMBERS))
        return data[:start] + number + data[start + len(number) :]
    if kind == "endian":
        width = draw(st.sampled_from([2, 4, 8]))
        return data[:start] + b"".join(
            data[at : at + width][::-1] for at in range(start, len(data), width)
        )
    if kind == "stretch":
        part = data[start : start + draw(st.integers(1, 64))]
        return (
            data[:start]
            + draw(st.sampled_from([b"", part + part, part[::-1]]))
            + data[start + len(part) :]
        )
    if kind == "longer":
        return data + draw(st.sampled_from([data, data * 200, bytes(1), bytes(16), data[-8:]]))
    return b"" if kind == "empty" else draw(st.binary(max_size=96))


@contextmanager
def one_line(kind: type[YearlocError], says: str) -> Iterator[None]:
    """The block raises an error of this kind, one line long, that matches `says`."""
    with pytest.raises(kind, match=says) as error:
        yield
    assert "\n" not in str(error.value)


def opened(reader: Reader, root: Path, sequence: str) -> Log | None:
    """Open a log, or fail with one line that names the folder (None); check that the log keeps its
    promises."""
    try:
        log = reader.open(root, sequence)
    except YearlocError as error:
        assert_line(error, root)
        return None
    assert (np.diff(log.stamps_ns) > 0).all()
    known = []
    for poses in (log.world_T_scan, log.odom_T_scan):
        assert poses.shape == (len(log.stamps_ns), 4, 4)
        known.append(np.isfinite(poses).all(axis=(1, 2)))
        assert np.isnan(poses[~known[-1]]).all()
        rotations = poses[known[-1], :3, :3]
        np.testing.assert_allclose(
            rotations @ rotations.swapaxes(1, 2), np.zeros_like(rotations) + np.eye(3), atol=1e-2
        )
        assert (np.linalg.det(rotations) > 0).all()
    assert (known[0] | known[1]).all()
    assert all(count > 0 for count in log.skipped.values())
    for row in range(len(log.stamps_ns)):
        try:
            points = log.points(row)
        except YearlocError as error:
            assert_line(error, root)
            continue
        assert points.shape[1:] == (3,)
        assert np.isfinite(points).all()
    return log


def assert_line(error: YearlocError, root: Path) -> None:
    assert "\n" not in str(error)
    assert str(root) in str(error)
