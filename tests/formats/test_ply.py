"""Tests PLY files, made by hand from the format's description."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pipeline.core.errors import LogError, YearlocError
from pipeline.formats import ply
from tests.readers.damage import assert_line, damaged, one_line

XYZ = "property float x\nproperty float y\nproperty float z\n"


def header(form: str, elements: str) -> str:
    return f"ply\nformat {form} 1.0\ncomment made by hand\n{elements}end_header\n"


ASCII = header("ascii", f"element vertex 2\n{XYZ}") + "1 2 3\n-1.5e1 nan 0.25\n"
BINARY = header("binary_little_endian", f"element vertex 2\n{XYZ}").encode() + bytes(24)


def read(folder: Path, data: bytes | str, most_points: int = 1000) -> NDArray[np.float64]:
    path = folder / "city.ply"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    blocks = list(ply.blocks(path, most_points))
    assert all(0 < len(block) <= most_points for block in blocks)
    return np.concatenate([np.empty((0, 3)), *blocks])


def test_lines_of_numbers_are_points(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(tmp_path, ASCII), [[1, 2, 3], [-15, np.nan, 0.25]])
    np.testing.assert_array_equal(
        read(tmp_path, ASCII.replace("\n", "\r\n"), 1), [[1, 2, 3], [-15, np.nan, 0.25]]
    )


@pytest.mark.parametrize(("form", "order"), [("little", "<"), ("big", ">")])
@pytest.mark.parametrize("most_points", [1, 2, 5])
def test_records_of_both_orders_may_hold_anything_between(
    tmp_path: Path, form: str, order: str, most_points: int
) -> None:
    # 1 byte of red, y as a signed 16-bit number, x as a double, a normal, z as a float: 1+2+8+4+4 =
    # 19 bytes.
    head = header(
        f"binary_{form}_endian",
        "element vertex 3\nproperty uchar red\nproperty int16 y\nproperty double x\n"
        "property float nx\nproperty float32 z\n",
    )
    rows = [(9, -2, 4e6 + 0.125, 7, 3.5), (8, 300, -1.25, 7, -1), (7, 0, 1e-3, 7, 0.5)]
    data = head.encode() + b"".join(struct.pack(f"{order}Bhdff", *row) for row in rows)
    assert len(data) == len(head) + 3 * 19
    expected = [[4e6 + 0.125, -2, 3.5], [-1.25, 300, -1], [1e-3, 0, 0.5]]
    np.testing.assert_array_equal(read(tmp_path, data, most_points), expected)


def test_other_elements_are_skipped_before_and_after_the_vertices(tmp_path: Path) -> None:
    elements = (
        "element camera 1\nproperty float focus\nproperty int width\n"
        "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\n"
        f"element vertex 2\n{XYZ}"
        "element edge 1\nproperty list ushort short ends\n"
    )
    # lists of three and of no numbers before, one of two after
    data = (
        struct.pack("<fi", 1, 2)
        + struct.pack("<BiiiB", 3, 0, 1, 1, 255)
        + struct.pack("<BB", 0, 255)
        + struct.pack("<6f", 1, 2, 3, 4, 5, 6)
        + struct.pack("<Hhh", 2, 0, 1)
    )
    expected = [[1, 2, 3], [4, 5, 6]]
    binary = header("binary_little_endian", elements).encode() + data
    np.testing.assert_array_equal(read(tmp_path, binary), expected)
    text = header("ascii", elements) + "1 2\n3 0 1 1 255\n0 255\n1 2 3\n4 5 6\n2 0 1\n"
    np.testing.assert_array_equal(read(tmp_path, text), expected)


def test_the_summary_counts_points_and_faces_and_knows_32_bit_floats(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    faces = "element face 7\nproperty list uchar int vertex_indices\n"
    path.write_text(header("ascii", f"element vertex 2\n{XYZ}{faces}"))
    found = ply.summary(path)
    assert (found.points, found.is_float32, found.faces) == (2, True, 7)
    path.write_text(header("ascii", f"element vertex 2\n{XYZ}").replace("float", "double"))
    found = ply.summary(path)
    assert (found.points, found.is_float32, found.faces) == (2, False, 0)


def test_written_points_come_back_as_32_bit_floats(tmp_path: Path) -> None:
    points = np.array([[1.5, -2, 3e5], [0.1, 0, 0]])
    data = ply.encode(points)
    assert data.endswith(struct.pack("<6f", 1.5, -2, 3e5, 0.1, 0, 0))
    np.testing.assert_array_equal(read(tmp_path, data), points.astype(np.float32))
    assert len(read(tmp_path, ply.encode(np.empty((0, 3))))) == 0


LISTS = header(
    "binary_little_endian", f"element face 1\nproperty list int int v\nelement vertex 1\n{XYZ}"
).encode()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "its first line is not 'ply'"),
        (ASCII[4:], "its first line is not 'ply'"),
        ("ply\n" + "comment\n" * 10_000, "no line 'end_header'"),
        (ASCII.replace("1.0", "2.0"), "a line 'format ascii 2.0' in its header"),
        (ASCII.replace("format ascii 1.0\n", ""), "no line 'format FORM 1.0'"),
        (ASCII.replace("float y", "real y"), "a line 'property real y' in its header"),
        (ASCII.replace("element vertex 2\n", ""), "a line 'property float x' in its header"),
        (ASCII.replace("vertex 2", "vertex -2"), "a line 'element vertex -2' in its header"),
        (ASCII.replace("vertex 2", "vertex " + "9" * 20), "it is damaged"),
        (ASCII.replace("vertex", "point"), "its elements are point; expected vertex, once"),
        (ASCII.replace("float z", "float i"), "are x y i; expected x, y and z, once each; a level"),
        (ASCII.replace("float z", "list int int z"), "each vertex has a list, z"),
        (ASCII.replace("float z", "list float int z"), "a line 'property list float int z'"),
        (ASCII.replace("vertex 2", "vertex 3"), "2 lines of points for the 3 points"),
        (ASCII + "1 2 3\n", "1 lines after the points, 0 by its header"),
        (ASCII.replace("1 2 3", "1 2 three"), "points are lines of 3 numbers"),
        (ASCII.replace("1 2 3\n-1.5e1 nan", "1 2\n3"), "2 numbers, 3 by its header"),
        (BINARY[:-1], "23 bytes of points, 24 for the 2 points"),
        (BINARY + b"1", "25 bytes of points, 24 for the 2 points"),
        (LISTS + struct.pack("<i", -1) + bytes(12), "a list of face has the length -1"),
        (LISTS + struct.pack("<i", 10**9) + bytes(12), "it ends among its face records"),
        (LISTS + b"1", "it ends among its face records"),
    ],
)
def test_a_damaged_file_raises_an_error_of_one_line(
    tmp_path: Path, data: bytes | str, says: str
) -> None:
    with one_line(LogError, f"^{tmp_path}/city.ply: .*{says}"):
        read(tmp_path, data)


WHOLE = header(
    "binary_big_endian",
    f"element face 1\nproperty list uchar int v\nelement vertex 3\nproperty uchar red\n{XYZ}",
).encode() + struct.pack(">Bii", 2, 0, 1) + 3 * struct.pack(">Bfff", 1, 2, 3, 4)  # fmt: skip


@pytest.mark.parametrize("data", [ASCII.encode(), WHOLE])
def test_whatever_is_damaged_points_or_an_error_of_one_line_come(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    folder = tmp_path_factory.mktemp("damaged")

    @settings(max_examples=60, suppress_health_check=list(HealthCheck))
    @given(damaged(data))
    def check(changed: bytes) -> None:
        try:
            assert read(folder, changed, 2).shape[1] == 3
        except YearlocError as error:
            assert_line(error, folder)

    check()


def test_points_come_back_block_by_block(tmp_path: Path) -> None:
    @settings(max_examples=20)
    @given(st.integers(0, 20), st.integers(1, 25))
    def check(count: int, most_points: int) -> None:
        points = np.arange(3.0 * count).reshape(-1, 3)
        np.testing.assert_array_equal(read(tmp_path, ply.encode(points), most_points), points)

    check()
