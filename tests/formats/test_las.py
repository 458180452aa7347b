"""Tests LAS and LAZ files, written by laspy."""

import struct
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

from pipeline.core.errors import LogError, NotInstalledError
from pipeline.formats import las
from tests.readers.damage import one_line


def write(path: Path, points: np.ndarray, form: int = 3, version: str = "1.2") -> Path:
    """Write points in steps of 1 mm around an origin in UTM, with a class and a colour."""
    head = laspy.LasHeader(point_format=form, version=version)
    head.scales = np.full(3, 0.001)
    head.offsets = np.array([690_000.0, 5_336_000.0, 500.0])
    record = laspy.LasData(head)
    record.x, record.y, record.z = points.T
    record.classification = np.full(len(points), 2)
    record.write(path)
    return path


# two points in UTM, given in whole millimetres
POINTS = np.array([[690_000.001, 5_336_000.25, 519.5], [690_100.5, 5_335_999.999, 480.0]])


@pytest.mark.parametrize("name", ["city.las", "city.laz", "CITY.LAZ"])
@pytest.mark.parametrize(("form", "version"), [(0, "1.2"), (3, "1.2"), (6, "1.4")])
def test_points_come_back_to_the_millimetre(
    tmp_path: Path, name: str, form: int, version: str
) -> None:
    path = write(tmp_path / name, np.tile(POINTS, (5, 1)), form, version)
    blocks = list(las.blocks(path, 4))
    assert [len(block) for block in blocks] == [4, 4, 2]
    assert all(block.dtype == np.float64 for block in blocks)
    np.testing.assert_allclose(np.concatenate(blocks), np.tile(POINTS, (5, 1)), atol=1e-8, rtol=0)
    found = las.summary(path)
    assert (found.points, found.is_float32, found.faces) == (10, False, 0)


@pytest.mark.parametrize("name", ["city.las", "city.laz"])
@pytest.mark.parametrize("share", [0, 0.2, 0.9])
def test_a_file_that_is_cut_short_raises_an_error_of_one_line(
    tmp_path: Path, name: str, share: float
) -> None:
    rng = np.random.default_rng(1)
    data = write(tmp_path / "whole.laz", POINTS[0] + rng.uniform(0, 99, (999, 3))).read_bytes()
    if name.endswith(".las"):
        data = write(tmp_path / "whole.las", POINTS).read_bytes()
    path = tmp_path / name
    path.write_bytes(data[: int(share * len(data))])
    with one_line(
        LogError,
        f"^{path}: (no LAS file|no readable LAS|.*its header counts more|.*it is cut short)",
    ):
        list(las.blocks(path, 1000))


def put(path: Path, at: int, form: str, *numbers: int) -> Path:
    """Overwrite numbers in a file."""
    data = bytearray(path.read_bytes())
    struct.pack_into(form, data, at, *numbers)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("at", "form", "number"),
    [
        (96, "<I", 10**9),  # where the points begin
        (100, "<I", 10**9),  # records before them
        (243, "<I", 10**9),  # records after them
    ],
)
def test_a_header_that_counts_a_billion_records_is_refused_at_once(
    tmp_path: Path, at: int, form: str, number: int
) -> None:
    path = put(write(tmp_path / "city.las", POINTS, 6, "1.4"), at, form, number)
    with one_line(LogError, f"^{path}: its header counts more records than its .* bytes hold"):
        las.summary(path)


def test_a_damaged_table_of_compressed_points_is_refused_at_once(tmp_path: Path) -> None:
    path = write(tmp_path / "city.laz", POINTS)
    (points_at,) = struct.unpack_from("<I", path.read_bytes(), 96)
    (table_at,) = struct.unpack_from("<q", path.read_bytes(), points_at)
    # the table: a version and the count of chunks, each of 50,000 points
    for chunks in (0, 2**32 - 1):
        put(path, table_at + 4, "<I", chunks)
        with one_line(LogError, f"^{path}: the table of its compressed points is damaged"):
            las.summary(path)
    for place in (0, -5, 2**62):
        put(path, points_at, "<q", place)
        with one_line(LogError, f"^{path}: the table of its compressed points is missing"):
            las.summary(path)


def test_a_table_whose_place_stands_at_the_end_is_found(tmp_path: Path) -> None:
    path = write(tmp_path / "city.laz", POINTS)
    (points_at,) = struct.unpack_from("<I", path.read_bytes(), 96)
    place = path.read_bytes()[points_at : points_at + 8]
    put(path, points_at, "<q", -1)
    path.write_bytes(path.read_bytes() + place)
    (block,) = las.blocks(path, 9)
    np.testing.assert_allclose(block, POINTS, atol=1e-8, rtol=0)


def test_a_panic_of_rust_is_an_error_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class PanicException(BaseException):
        pass

    def panics(*_: object, **__: object) -> None:
        raise PanicException("mid > len\nnote: run with RUST_BACKTRACE=1")

    path = write(tmp_path / "city.laz", POINTS)
    monkeypatch.setattr(laspy, "open", panics)
    with one_line(LogError, rf"^{path}: no readable LAS file \(mid > len\); save it again$"):
        las.summary(path)


def test_records_are_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # format 3 has 34 bytes a point: pieces of 70 bytes hold two
    monkeypatch.setattr(las, "PIECE_BYTES", 70)
    path = write(tmp_path / "city.laz", np.tile(POINTS, (3, 1)))
    blocks = list(las.blocks(path, 5))
    assert [len(block) for block in blocks] == [5, 1]
    np.testing.assert_allclose(np.concatenate(blocks), np.tile(POINTS, (3, 1)), atol=1e-8, rtol=0)


def test_another_format_is_no_las(tmp_path: Path) -> None:
    path = tmp_path / "city.las"
    path.write_bytes(b"ply\n" + bytes(500))
    with one_line(LogError, f"^{path}: no LAS file: it does not begin with 'LASF'"):
        las.summary(path)


@pytest.mark.parametrize("package", ["laspy", "lazrs"])
def test_without_the_extra_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    path = write(tmp_path / "city.laz", POINTS)
    monkeypatch.setitem(sys.modules, package, None)
    with one_line(
        NotInstalledError, rf"^{package}: not installed; `pip install 'yearloc\[las\]'` \(3 MB\)$"
    ):
        las.summary(path)
