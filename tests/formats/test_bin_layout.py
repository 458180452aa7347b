"""Tests how the layout of a .bin of points is found from its bytes."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.formats.bin_layout import point_bytes, points, refuse_planar, width_of

EXTRA = {
    12: [],
    16: [("intensity", "<f4")],
    20: [("intensity", "<f4"), ("ring", "<f4")],
    22: [("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")],
    26: [
        ("intensity", "<f4"),
        ("t", "<u4"),
        ("reflectivity", "<u2"),
        ("ring", "<u2"),
        ("ambient", "<u2"),
    ],
}
"""The fields of a record after x, y and z, by its width."""
REAL = Path(__file__).parents[3] / "shared/real"


def sweep(width: int, count: int = 2000) -> tuple[bytes, np.ndarray]:
    """A .bin of so many points in rings on the walls of a room of 12 × 8 m, and the points.

    The other fields of its records hold what a sensor writes there.
    """
    rng = np.random.default_rng(0)
    turn = np.linspace(0, 40 * np.pi, count)
    range_m = 1 / np.maximum(np.abs(np.cos(turn)) / 6, np.abs(np.sin(turn)) / 4)
    xyz = np.column_stack(
        [range_m * np.cos(turn), range_m * np.sin(turn), 0.1 * np.floor(turn / 6.3)]
    ).astype("<f4")
    rows = np.zeros(count, [("xyz", "<f4", 3), *EXTRA[width]])
    rows["xyz"] = xyz
    for name, kind in EXTRA[width]:
        column = {
            "intensity": rng.uniform(0, 1, count),
            "ring": np.floor(turn / 6.3),
            "time": np.linspace(0, 0.1, count),
        }
        rows[name] = column.get(name, np.arange(count) * (1000 if kind == "<u4" else 1))
    return rows.tobytes(), xyz


@pytest.mark.parametrize("width", EXTRA)
def test_the_width_of_a_record_is_found_and_its_points_are_read(width: int) -> None:
    data, xyz = sweep(width)
    assert point_bytes(data) == width
    np.testing.assert_array_equal(points(data, Path("1.bin")), xyz)


def test_few_points_have_the_commonest_layout_that_fits() -> None:
    few, _ = sweep(16, 10)
    assert point_bytes(few) == 16


@pytest.mark.parametrize("width", [12, 16, 20])
def test_the_width_is_found_of_points_in_no_order_whatever_their_count(width: int) -> None:
    """1,980 points are a whole number of records of 12, of 16 and of 20 bytes. Since the points are
    in no order, their neighbours in the file do not help."""
    data, _ = sweep(width, 1980)
    rows = np.frombuffer(data, np.uint8).reshape(-1, width)
    mixed = np.random.default_rng(1).permutation(rows).tobytes()
    assert width_of(mixed) == (width, True)


def test_the_width_is_a_guess_if_several_fit() -> None:
    """In a cube filled evenly, heights are distributed as positions are; and 500 points of 16 bytes
    may as well be 400 of 20 bytes."""
    cube = np.random.default_rng(0).uniform(-20, 20, (500, 4)).astype("<f4").tobytes()
    assert width_of(cube) == (16, False)


def test_a_cloud_as_high_as_it_is_wide_is_not_taken_for_one_by_columns() -> None:
    """The cloud is a shaft of 12 m in each direction, scanned from below to above."""
    rng = np.random.default_rng(0)
    shaft = np.column_stack(
        [rng.uniform(-6, 6, (4000, 2)), np.linspace(-6, 6, 4000), rng.uniform(0, 1, 4000)]
    ).astype("<f4")
    refuse_planar(shaft.tobytes(), Path("1.bin"))
    np.testing.assert_array_equal(points(shaft.tobytes(), Path("1.bin")), shaft[:, :3])


@pytest.mark.parametrize("ordered", [True, False])
@pytest.mark.parametrize("width", [12, 16, 20])
def test_a_file_of_all_x_then_all_y_is_refused_with_what_to_do(width: int, ordered: bool) -> None:
    data, _ = sweep(width)
    rows = np.frombuffer(data, "<f4").reshape(-1, width // 4)
    rows = rows if ordered else np.random.default_rng(1).permutation(rows)
    with pytest.raises(
        LogError,
        match=r"1.bin: holds all x, then all y, then all z; with N numbers .*reshape\(N, -1\)",
    ):
        points(rows.T.tobytes(), Path("1.bin"))
    refuse_planar(rows.tobytes(), Path("1.bin"))


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "0 bytes that are no points"),
        (bytes(1600), "bytes that are no points"),
        (np.random.default_rng(0).bytes(8000), "bytes that are no points"),
        (
            np.tile(np.array([20000, 20100, 19000, 7 << 8], "<u2"), 100).tobytes(),
            "integers as NCLT's; the dataset nclt reads",
        ),
    ],
    ids=["empty", "zeros", "noise", "nclt"],
)
def test_what_holds_no_floats_is_refused(data: bytes, why: str) -> None:
    with pytest.raises(LogError, match=f"1.bin: .*{why}"):
        points(data, Path("1.bin"))


@pytest.mark.skipif(not REAL.is_dir(), reason="no real data beside the project")
def test_the_layout_of_real_scans_is_found() -> None:
    paths_by_width = {
        8: REAL.glob("nclt/*/velodyne_sync/*.bin"),
        16: REAL.glob("kitti/sequences/00/velodyne/*.bin"),
    }
    for width, paths in paths_by_width.items():
        assert {point_bytes(path.read_bytes()) for path in paths} == {width}
