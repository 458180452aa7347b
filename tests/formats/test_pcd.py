"""Tests PCD files, made by hand from the format's description, and round trips through a small
writer of all three forms."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats import pcd, records
from tests.readers.damage import one_line

PATH = Path("scan.pcd")
LARGEST = 2**28


def header(
    data: str,
    fields: str = "x y z",
    sizes: str = "4 4 4",
    types: str = "F F F",
    counts: str = "1 1 1",
    points: int = 2,
) -> str:
    return (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {fields}\nSIZE "
        f"{sizes}\nTYPE {types}\nCOUNT {counts}\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 "
        f"0\nPOINTS {points}\nDATA {data}\n"
    )


def read(data: bytes | str) -> NDArray[np.float64]:
    return pcd.decode(data if isinstance(data, bytes) else data.encode(), PATH, LARGEST)


def compressed(columns: bytes, block: bytes, head: str | None = None) -> bytes:
    """A compressed PCD: header, sizes of the LZF `block` and of the `columns` in it, the block."""
    return (
        (head or header("binary_compressed")).encode()
        + struct.pack("<II", len(block), len(columns))
        + block
    )


def literals(data: bytes) -> bytes:
    """LZF that copies nothing: runs of up to 32 bytes, each after a byte with its length − 1."""
    packed = b""
    for start in range(0, len(data), 32):
        run = data[start : start + 32]
        packed += bytes([len(run) - 1]) + run
    return packed


def written(points: NDArray[np.float32], data: str) -> bytes:
    """A PCD of points x, y, z with an intensity of 7; `data` is its form."""
    table = np.column_stack([points, np.full(len(points), 7, np.float32)]).astype("<f4")
    head = header(data, "x y z intensity", "4 4 4 4", "F F F F", "1 1 1 1", len(points))
    if data == "ascii":
        return (head + "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist())).encode()
    if data == "binary":
        return head.encode() + table.tobytes()
    columns = table.T.tobytes()
    return compressed(columns, literals(columns), head)


def test_lines_of_numbers_are_points() -> None:
    found = read(header("ascii") + "1 2 3\n-1.5e1 nan 0.25\n")
    np.testing.assert_array_equal(found, [[1, 2, 3], [-15, np.nan, 0.25]])


def test_records_are_little_endian_and_may_hold_anything_between() -> None:
    # 2 bytes of ring, then z, a padding of three 1-byte fields, x as a double, y as a signed 16-bit
    # number: 2+4+3+8+2 = 19.
    head = header("binary", "ring z _ x y", "2 4 1 8 2", "U F U F I", "1 1 3 1 1")
    data = struct.pack("<Hf3Bdh", 9, 3.5, 1, 2, 3, 1.25, -2) + struct.pack(
        "<Hf3Bdh", 9, -1, 1, 2, 3, 1e5, 300
    )
    assert len(data) == 2 * 19
    np.testing.assert_array_equal(read(head.encode() + data), [[1.25, -2, 3.5], [1e5, 300, -1]])


def test_the_headers_lines_may_come_in_any_order_and_without_counts() -> None:
    lines = header("ascii").replace("COUNT 1 1 1\n", "").splitlines()
    shuffled = "\n".join([*reversed(lines[:-1]), lines[-1]])
    np.testing.assert_array_equal(read(f"{shuffled}\n1 2 3\n4 5 6\n"), [[1, 2, 3], [4, 5, 6]])


def test_a_compressed_block_holds_one_field_after_the_other() -> None:
    # Points (1, 2, 3) and (1, 2, 3): x x y y z z. As 32-bit floats 1 is 0000803f, 2 is 00000040, 3
    # is 00004040. By hand: four literals "0000803f" (control 3), copy 4 from 4 back (control
    # (4−2)·32, then 3), and so for y and z.
    columns = bytes.fromhex("0000803f0000803f 0000004000000040 0000404000004040")
    block = bytes.fromhex("03 0000803f 40 03  03 00000040 40 03  03 00004040 40 03")
    np.testing.assert_array_equal(read(compressed(columns, block)), [[1, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(
        read(compressed(columns, literals(columns))), [[1, 2, 3], [1, 2, 3]]
    )


def test_a_long_copy_reads_what_it_writes() -> None:
    # 100 points at 0: 1,200 zero bytes. A literal zero (control 0), then copies from 1 back (low
    # byte 0) of 9 + 255 = 264 bytes (control 7·32, then 255): four of them make 1,056, and one of 9
    # + 134 = 143 the rest.
    block = bytes.fromhex("00 00") + 4 * bytes.fromhex("e0 ff 00") + bytes([0xE0, 134, 0])
    found = read(compressed(bytes(1200), block, header("binary_compressed", points=100)))
    np.testing.assert_array_equal(found, np.zeros((100, 3)))


def test_a_copy_may_reach_eight_thousand_bytes_back() -> None:
    # 8,192 back is 31·256 + 255 + 1: upper bits 31, low byte 255. One point of 12 bytes with a
    # field of 8,188 behind it.
    rng = np.random.default_rng(3)
    first = rng.bytes(8192)
    data = first + first[:8]
    block = literals(first) + bytes([(8 - 2) << 5 | 31, 255])
    head = header("binary_compressed", "x y z more", "4 4 4 1", "F F F U", "1 1 1 8188", 1)
    found = read(compressed(data, block, head))
    np.testing.assert_array_equal(found[0], np.frombuffer(first[:12], "<f4"))


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
@given(st.lists(st.tuples(*[st.floats(-1e4, 1e4, width=32)] * 3), max_size=40))
@settings(max_examples=30)
def test_points_come_back(data: str, points: list[tuple[float, ...]]) -> None:
    cloud = np.array(points, np.float32).reshape(-1, 3)
    np.testing.assert_array_equal(read(written(cloud, data)), cloud.astype(np.float64))


ASCII = header("ascii") + "1 2 3\n4 5 6\n"
BINARY = header("binary").encode() + bytes(24)
ZEROS = compressed(bytes(24), literals(bytes(24)))
BLOCKS = (
    literals(bytes(23)),
    bytes([0x20, 0]),  # copies from before the start
    bytes([31]) + bytes(5),  # 32 literals, five there
    bytes([0, 0, 0xE0]),  # a copy without its length
    bytes([0, 0, 0xE0, 255, 0]),  # copies over the end
)
HUGE = header("binary", points=10**12).encode()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no line 'DATA"),
        ("FIELDS x y z\n" * 10_000, "no line 'DATA"),
        (ASCII.replace("VERSION 0.7", "VERSION 0.5"), "PCD version 0.5; expected 0.7"),
        (ASCII.replace("x y z", "x y i"), "expected x, y and z, once each"),
        (ASCII.replace("COUNT 1 1 1", "COUNT 1 2 1"), "expected x, y and z, once each"),
        (ASCII.replace("SIZE 4 4 4", "SIZE 4 4"), "are of 3, 2, 3 and 3 fields"),
        (ASCII.replace("TYPE F F F", "TYPE F F Q"), "TYPE Q and SIZE 4"),
        (ASCII.replace("SIZE 4 4 4", "SIZE 4 4 2"), "TYPE F and SIZE 2"),
        (ASCII.replace("COUNT 1 1 1", "COUNT 1 -1 1"), "COUNT 1 -1 1; expected whole numbers"),
        (ASCII.replace("POINTS 2\n", "").replace("WIDTH 2\n", ""), "no line 'POINTS NUMBER'"),
        (
            ASCII.replace("POINTS 2\n", "").replace("HEIGHT 1", "HEIGHT 2"),
            "2 lines of points for the 4 points",
        ),
        (ASCII.replace("POINTS 2", "POINTS two"), "POINTS two; expected whole numbers"),
        (
            ASCII.replace("DATA ascii", "DATA text"),
            "DATA text; expected ascii, binary or binary_compressed",
        ),
        (ASCII + "7 8 9\n", "3 lines of points for the 2 points"),
        (ASCII.replace("1 2 3\n4 5 6", "1 2\n4 5"), "2 numbers, 3 by its header"),
        (ASCII.replace("4 5 6", "4 5 six"), "lines of 3 numbers"),
        (BINARY[:-1], "23 bytes of points, 24 for the 2 points"),
        (HUGE, "0 bytes of points, 12000000000000 for"),
        (ZEROS[:-1], "bytes, 23 follow; the file is damaged|bytes, 24 follow; the file is damaged"),
        (ZEROS[: len(header("binary_compressed")) + 5], "no sizes after"),
        (compressed(bytes(25), literals(bytes(24))), "25 bytes of points, 24 for"),
        *((compressed(bytes(24), block), "compressed block is damaged") for block in BLOCKS),
    ],
)
def test_a_damaged_file_raises_an_error_of_one_line(data: bytes | str, says: str) -> None:
    with one_line(LogError, f"^scan.pcd: .*({says})"):
        read(data)


@pytest.mark.parametrize("points", [357_913_941, 20_000_000])
def test_a_block_that_claims_gigabytes_is_refused_before_they_are_taken(points: int) -> None:
    # 12 · 357,913,941 is 2³² − 4 bytes; 240 MB are within the largest scan, yet 1,000 bytes of LZF
    # hold 88,000 at most.
    head = header("binary_compressed", points=points).encode()
    with pytest.raises(LogError, match="claims that 1000 compressed bytes hold"):
        read(head + struct.pack("<II", 1000, 12 * points) + bytes(1000))


@pytest.mark.parametrize(
    ("line", "other"),
    [("POINTS 2\n", ""), ("HEIGHT 1\n", ""), ("HEIGHT 1", "HEIGHT 2"), ("WIDTH 2\nHEIGHT 1\n", "")],
)
def test_the_count_of_points_may_be_given_once(line: str, other: str) -> None:
    np.testing.assert_array_equal(read(ASCII.replace(line, other)), [[1, 2, 3], [4, 5, 6]])


def test_writers_that_leave_the_width_at_0_and_fill_a_page_with_zeros_are_read() -> None:
    points = np.arange(6, dtype=np.float32).reshape(2, 3)
    odd = written(points, "binary_compressed").replace(
        b"WIDTH 2\nHEIGHT 1", b"WIDTH 0\nHEIGHT 0"
    ) + bytes(100)
    np.testing.assert_array_equal(read(odd), points)
    with pytest.raises(LogError, match="the file is damaged"):
        read(odd + b"\1")


def test_real_key_frames_of_nclt_are_read(real: Path) -> None:
    """METHODS 7.6: 498 to 5,435 points each, half of them 3,268 or fewer, the ground some .78 m
    below."""
    paths = sorted((real / "nclt_keyframes").glob("*.pcd"))[::20]
    clouds = [pcd.decode(path.read_bytes(), path, LARGEST) for path in paths]
    counts = np.array([len(cloud) for cloud in clouds])
    assert 498 <= counts.min() <= counts.max() <= 5435
    assert 2800 < np.median(counts) < 3600
    assert -1.0 < np.median([np.percentile(cloud[:, 2], 10) for cloud in clouds]) < -0.6


def blocks(folder: Path, data: bytes | str, most_points: int) -> list[NDArray[np.float64]]:
    path = folder / "city.pcd"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return list(pcd.blocks(path, most_points))


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_a_map_is_read_block_by_block(tmp_path: Path, data: str) -> None:
    points = np.arange(21, dtype=np.float32).reshape(7, 3)
    found = blocks(tmp_path, written(points, data), 3)
    assert [len(block) for block in found] == [3, 3, 1]
    np.testing.assert_array_equal(np.concatenate(found), points)
    assert blocks(tmp_path, written(points[:0], data), 3) == []


def test_doubles_in_utm_keep_their_millimetres(tmp_path: Path) -> None:
    # as a 32-bit float the northing would be a multiple of .5
    point = [690_000.001, 5_336_000.251, 519.503]
    head = header("binary", "x y z", "8 8 8", "F F F", "1 1 1", 1)
    (found,) = blocks(tmp_path, head.encode() + struct.pack("<3d", *point), 9)
    np.testing.assert_array_equal(found, [point])
    assert not pcd.summary(tmp_path / "city.pcd").is_float32
    head = header("ascii", "x y z", "8 8 8", "F F F", "1 1 1", 1)
    (found,) = blocks(tmp_path, f"{head}{point[0]} {point[1]} {point[2]}\n", 9)
    np.testing.assert_array_equal(found, [point])


def test_records_larger_than_a_piece_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 16 bytes a record: pieces of 40 bytes hold two records, pieces of 8 none, so one is read.
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    for piece_bytes in (40, 8):
        monkeypatch.setattr(records, "PIECE_BYTES", piece_bytes)
        (found,) = blocks(tmp_path, written(points, "binary"), 5)
        np.testing.assert_array_equal(found, points)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (ASCII + "7 8 9\n", "3 lines of points for the 2 points"),
        (ASCII[:-6], "1 lines of points for the 2 points"),
        (BINARY[:-1], "23 bytes of points, 24 for the 2 points"),
        (ZEROS[:-1], "the file is damaged"),
    ],
)
def test_a_damaged_map_raises_the_same_errors(tmp_path: Path, data: bytes | str, says: str) -> None:
    with one_line(LogError, f"^{tmp_path}/city.pcd: .*{says}"):
        blocks(tmp_path, data, 1)


def test_a_compressed_map_beyond_the_limit_says_how_to_save_it() -> None:
    with one_line(LogError, "unpacks to 24 bytes, at most 23 are; save it as DATA binary"):
        pcd.decode(ZEROS, PATH, 23)
