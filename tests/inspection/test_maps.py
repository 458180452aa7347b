"""Tests what `inspect` says of a 3-D map before it is packed."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.formats import autoware, pcd, ply
from pipeline.inspection.report import inspect
from tests.inspection.made_maps import Points, floor, house, walls, write_pcd, yard
from tests.inspection.scanner import assert_says, scan
from tests.readers.damage import one_line

UTM_M = np.array([690_000.0, 4_100_000.0, 500.0])


def test_a_level_yard_is_a_map_with_ground_walls_and_the_command_to_pack_it(
    tmp_path: Path,
) -> None:
    found = inspect(write_pcd(tmp_path / "yard.pcd", yard(), fields="intensity"))
    # a voxel of .4 m of the ground every .4 m: 150 x 150, 6.25 a m²
    assert_says(
        found,
        "yard.pcd — 3-D map",
        "left out: intensity",
        "32-bit floats",
        "x 0.1 … 59.9 m, y 0.1 … 59.9 m, z 0.0 … 5.8 m",
        "covered  3,600 m²",
        "shown   in the map",
        "the whole map 0.0°",
        "z 0.0 … 0.0 m",
        "storeys  one",
    )
    assert found.warnings == ()
    assert found.text().splitlines()[-1] == (
        f"next: yearloc pack --map {tmp_path}/yard.pcd -o yard.site"
    )


def test_a_tilt_of_the_whole_map_is_measured(tmp_path: Path) -> None:
    points = yard()
    points[:, 2] += np.tan(np.radians(3.0)) * points[:, 0]
    found = inspect(write_pcd(tmp_path / "yard.pcd", points))
    # the slope is pulled to 0 a little where there are few cells, so 3° are 2 to 3
    text = found.text()
    whole_deg = float(text.split("the whole map ")[1].split("°")[0])
    assert 2.4 < whole_deg < 3.1
    assert_says(found, "shown   in the map")


def test_a_ground_that_is_cut_off_asks_for_a_scan_of_the_robot(tmp_path: Path) -> None:
    points = yard()
    # the lowest point of each column of a wall is .3 m to 4.3 m above the ground
    columns = np.floor(points[:, :2]).astype(int)
    lowest_m = np.random.default_rng(0).uniform(0.3, 4.3, (60, 60))[tuple(columns.T)]
    found = inspect(write_pcd(tmp_path / "yard.pcd", points[points[:, 2] > lowest_m]))
    assert_says(found, "cut off", "--like SCAN")
    assert found.next.endswith("yard.pcd --like SCAN -o yard.site")


@pytest.mark.parametrize(
    ("turn", "up", "coordinates"),
    [
        # what turns z up into the named axis up; each keeps a right-handed frame
        (lambda x, y, z: (x, z, -y), "y", "(x, −z, y)"),
        (lambda x, y, z: (x, -z, y), "−y", "(x, z, −y)"),
        (lambda x, y, z: (z, x, y), "x", "(y, z, x)"),
        (lambda x, y, z: (-z, y, x), "−x", "(z, y, −x)"),
        (lambda x, y, z: (x, -y, -z), "−z", "(x, −y, −z)"),
    ],
)
def test_another_axis_that_is_up_is_named_with_the_turn_that_puts_it_right(
    tmp_path: Path, turn, up: str, coordinates: str
) -> None:
    points = np.column_stack(turn(*yard().T))
    (warning,) = inspect(write_pcd(tmp_path / "yard.pcd", points)).warnings
    assert warning.startswith(f"{up} seems to be up, not z")
    assert f"save each point as {coordinates}," in warning


def test_coordinates_of_a_countrys_grid_in_32_bits_are_warned_of(tmp_path: Path) -> None:
    (warning,) = inspect(write_pcd(tmp_path / "yard.pcd", yard() + UTM_M)).warnings
    # between 2²¹ and 2²² = 4,194,304 the step of 32-bit floats is 1/4
    assert "are rounded to 0.25 m" in warning
    assert "the origin 690000,4100000,0 subtracted" in warning


def test_coordinates_of_a_countrys_grid_in_64_bits_are_kept(tmp_path: Path) -> None:
    found = inspect(write_pcd(tmp_path / "yard.pcd", yard() + UTM_M, "<f8"))
    assert_says(found, "64-bit floats", "nothing is rounded", "--origin 690000,4100000,0")
    assert found.warnings == ()


@pytest.mark.parametrize(("storeys", "count"), [(1, 0), (2, 1), (3, 1)])
def test_storeys_above_each_other_are_warned_of_and_a_ceiling_is_not(
    tmp_path: Path, storeys: int, count: int
) -> None:
    found = inspect(write_pcd(tmp_path / "house.pcd", house(storeys)), "map")
    assert sum("pack each storey as a map of its own" in text for text in found.warnings) == count


def test_stray_points_are_counted(tmp_path: Path) -> None:
    strays = np.array([[500.0, 500, 0], [700, 100, 3]])
    found = inspect(write_pcd(tmp_path / "yard.pcd", np.concatenate([yard(), strays])))
    # means of voxels of .4 m, which hold points .25 m apart: .25 m to 59.75 m
    assert_says(found, "strays   2 voxels")
    assert_says(found, "59.5 m × 59.5 m")


def test_a_map_without_walls_cannot_be_packed(tmp_path: Path) -> None:
    points = floor()
    points[::2, 2] = 0.1
    found = inspect(write_pcd(tmp_path / "field.pcd", points))
    assert found.next == ""
    assert found.warnings == (
        "it cannot be packed: nothing stands 1–8 m above the ground; a map without walls or trees "
        "cannot be searched",
    )


def test_an_object_is_no_map_of_a_place(tmp_path: Path) -> None:
    points = np.concatenate([floor(side_m=8.0), walls(side_m=8.0)]) + np.array([100, 0, 0])
    found = inspect(write_pcd(tmp_path / "car.pcd", points))
    assert "it cannot be packed: its points lie within 8 × 8 m" in found.warnings[0]
    assert found.next == ""


def test_a_level_map_is_refused_with_the_way_to_pack_a_plan(tmp_path: Path) -> None:
    with one_line(LogError, r"a 2-D map.*yearloc pack --map hall\.yaml"):
        (tmp_path / "hall.ply").write_bytes(ply.encode(floor()))
        inspect(tmp_path / "hall.ply")


def tiles(folder: Path, points: Points) -> Path:
    folder.mkdir()
    autoware.write_tiles(folder, [points], 20)
    return folder


def test_autowares_folder_is_a_map_by_its_metadata(tmp_path: Path) -> None:
    folder = tiles(tmp_path / "city map", yard())
    # 3 x 3 tiles of 20 m
    for path in (folder, folder / autoware.METADATA):
        found = inspect(path)
        assert_says(found, "3-D map", "files        9 .pcd")
        assert found.next == f"yearloc pack --map '{path}' -o 'city map.site'"


def test_tiles_without_metadata_are_a_map_since_they_do_not_overlap(tmp_path: Path) -> None:
    folder = tiles(tmp_path / "city", yard())
    (folder / autoware.METADATA).unlink()
    assert_says(inspect(folder), "3-D map", "files        9 .pcd")


def test_a_folder_of_scans_is_described_as_scans(tmp_path: Path) -> None:
    for number in range(4):
        (tmp_path / f"{number}.pcd").write_bytes(pcd.encode(scan(beams=8 + number)))
    assert_says(inspect(tmp_path), "scans of another robot")


def test_a_scan_in_a_pcd_is_described_as_a_scan(tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    path.write_bytes(pcd.encode(scan()))
    assert_says(inspect(path), "PCD cloud", "beams")


def test_one_scan_that_is_taken_for_a_map_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(ply.encode(scan() + np.array([300, 0, 0])))
    found = inspect(path)
    assert any(text.startswith("one scan rather than a map") for text in found.warnings)
