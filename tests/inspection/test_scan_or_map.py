"""Tests how maps are told from scans by their points."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.formats import pcd
from pipeline.inspection.scan_or_map import is_map_file, is_map_folder, is_scan
from tests.inspection.made_maps import write_pcd, yard
from tests.inspection.scanner import scan


@pytest.mark.parametrize(
    "points", [scan(), scan(beams=16, ground_m=-1.8), scan(azimuth_deg=120.0), 1e3 * scan()]
)
def test_points_that_spread_with_the_distance_are_a_scan(points) -> None:
    assert is_scan(points)


def test_points_of_equal_density_are_no_scan_wherever_the_origin_is() -> None:
    for corner_m in ((0, 0, 0), (-30, -30, 0), (-5, -40, 2)):
        assert not is_scan(yard() + corner_m)


def test_points_away_from_the_origin_are_no_scan_of_its_sensor() -> None:
    moved = scan() + np.array([41, 0, 0])  # the yard reaches 30 m from the sensor, so 11 m are free
    assert not is_scan(moved)
    assert is_scan(moved, np.array([41.0, 0, 0]))


def test_too_few_points_are_taken_for_a_scan() -> None:
    assert is_scan(yard()[:499])


def test_a_damaged_file_is_left_to_the_reader_of_scans(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(b"VERSION 0.7\nDATA binary\n")
    assert not is_map_file(tmp_path / "a.pcd")
    assert not is_map_folder(tmp_path)


def test_scans_in_the_world_that_overlap_are_no_tiles(tmp_path: Path) -> None:
    for number in range(5):
        points = scan(beams=8) + np.array([100 + 2 * number, 0, 0])
        (tmp_path / f"{number}.pcd").write_bytes(pcd.encode(points))
    assert not is_map_folder(tmp_path)


def test_a_folder_with_one_map_is_that_map(tmp_path: Path) -> None:
    write_pcd(tmp_path / "yard.pcd", yard())
    assert is_map_folder(tmp_path)
