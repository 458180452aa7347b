"""Damages files at random, as disks, cables and editors do, and checks what a reader makes of them.

A reader either returns a log that is as the class Log says, or raises an error of one line.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from pipeline.core.errors import YearlocError
from pipeline.readers.log import Log, Reader

FAULTS = (
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
"""The faults that `damaged` makes; some are drawn twice as often."""
WORDS = [
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
    b"",
    b"0.5",
    b"1 2",
    b"#",
    b'"',
    b"\xff",
    b"\0",
    b"0x10",
    b"1_0",
    b"INS_INACTIVE",
    b"31U",
]
"""Words that replace others in a text."""
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
"""Bytes that replace others: as little-endian integers they are huge, as floats NaN or −inf."""


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with one fault: some bytes, words or rows lost, changed, repeated or moved."""
    fault = draw(st.sampled_from(FAULTS))
    start = draw(st.integers(0, max(len(data) - 1, 0)))
    if fault == "cut":
        return data[:start]
    if fault == "flip":
        flipped = bytearray(data)
        for bit in draw(st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=8)):
            flipped[bit // 8] ^= 1 << bit % 8
        return bytes(flipped)
    if fault == "words":
        pieces = re.split(rb"([,\s])", data)
        for _ in range(draw(st.integers(1, 3))):
            pieces[2 * draw(st.integers(0, len(pieces) // 2))] = draw(st.sampled_from(WORDS))
        return b"".join(pieces)
    if fault == "rows":  # one is lost, repeated, or replaced by another
        rows = data.split(b"\n")
        row = draw(st.integers(0, len(rows) - 1))
        other = draw(st.integers(0, len(rows) - 1))
        changed = draw(st.sampled_from([[], [rows[row]] * 2, [rows[other]]]))
        return b"\n".join(rows[:row] + changed + rows[row + 1 :])
    if fault == "number":
        number = draw(st.sampled_from(NUMBERS))
        return data[:start] + number + data[start + len(number) :]
    if fault == "endian":
        width = draw(st.sampled_from([2, 4, 8]))
        words = [data[at : at + width] for at in range(start, len(data), width)]
        return data[:start] + b"".join(word[::-1] for word in words)
    if fault == "stretch":  # it is lost, repeated, or turned round
        part = data[start : start + draw(st.integers(1, 64))]
        changed_part = draw(st.sampled_from([b"", part + part, part[::-1]]))
        return data[:start] + changed_part + data[start + len(part) :]
    if fault == "longer":
        return data + draw(st.sampled_from([data, data * 200, bytes(1), bytes(16), data[-8:]]))
    if fault == "empty":
        return b""
    return draw(st.binary(max_size=96))


@contextmanager
def one_line(kind: type[YearlocError], says: str) -> Iterator[None]:
    """Check that the block raises an error of this kind, one line long, that matches `says`."""
    with pytest.raises(kind, match=says) as error:
        yield
    assert "\n" not in str(error.value)


def opened(reader: Reader, root: Path, sequence: str) -> Log | None:
    """Open a log and check that it is as the class Log says.

    If the reader refuses it, check that the error is one line that names the folder; return None.
    """
    try:
        log = reader.open(root, sequence)
    except YearlocError as error:
        assert_line(error, root)
        return None
    assert (np.diff(log.stamps_ns) > 0).all()
    has_ground_truth = assert_poses(log.world_T_scan, len(log.stamps_ns))
    has_odometry = assert_poses(log.odom_T_scan, len(log.stamps_ns))
    assert (has_ground_truth | has_odometry).all()
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


def assert_poses(poses: np.ndarray, count: int) -> np.ndarray:
    """Check that poses (count, 4, 4) are all NaN or have a rotation; True (count,) where known."""
    assert poses.shape == (count, 4, 4)
    is_known = np.isfinite(poses).all(axis=(1, 2))
    assert np.isnan(poses[~is_known]).all()
    rotations = poses[is_known, :3, :3]
    identities = np.broadcast_to(np.eye(3), rotations.shape)
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), identities, atol=1e-2)
    assert (np.linalg.det(rotations) > 0).all()
    return is_known


def assert_line(error: YearlocError, root: Path) -> None:
    """Check that an error is one line that names the folder."""
    assert "\n" not in str(error)
    assert str(root) in str(error)
