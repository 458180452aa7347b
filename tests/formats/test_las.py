"""Tests LAS and LAZ files, written by laspy."""

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
    with one_line(LogError, f"^{path}: (no readable LAS|.* by its header; it is cut short)"):
        list(las.blocks(path, 1000))


def test_another_format_is_no_las(tmp_path: Path) -> None:
    path = tmp_path / "city.las"
    path.write_bytes(b"ply\n" + bytes(500))
    with one_line(LogError, f"^{path}: no readable LAS file"):
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
