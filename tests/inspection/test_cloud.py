"""Tests the diagnosis of clouds: beams, ground and sensor, and a warning for each fault."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.inspection.cloud import diagnose
from pipeline.readers.kitti import Kitti
from pipeline.readers.nclt import read_velodyne_sync
from tests.inspection.scanner import scan


def test_a_healthy_scan_is_measured_and_draws_no_warning() -> None:
    found = diagnose(scan())
    assert found.warnings == ()
    assert found.beams == 32
    assert found.ground_m == pytest.approx(0.0, abs=0.05)
    assert found.sensor_m == pytest.approx(1.8, abs=0.1)
    assert found.azimuth_deg == 360
    assert found.range_m[2] == pytest.approx(np.hypot(30, 18), abs=0.2)  # the yard's corner


@pytest.mark.parametrize("beams", [16, 32, 64])
def test_beams_are_counted_from_the_points_alone(beams: int) -> None:
    assert diagnose(scan(beams)).beams == beams


def test_the_sensor_stands_over_the_ground_by_what_is_known() -> None:
    assert diagnose(scan(ground_m=-1.73)).sensor_m == pytest.approx(
        1.73, abs=0.05
    )  # its points start at it
    assert diagnose(scan(), mounted_m=1.9).sensor_m == pytest.approx(1.9, abs=0.05)


def test_laser_ids_overrule_the_estimate() -> None:
    points = scan(16)
    assert diagnose(points, np.resize(np.arange(32, dtype=np.uint8), len(points))).beams == 32


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (scan(16), "16 beams:"),
        (scan() * (1, -1, -1), "z points down"),
        (scan(ground_m=-1.73), "ground at z = −1.73 m, not 0"),
        (scan(azimuth_deg=180), "not all round: 180° of 360° covered"),
        (scan(azimuth_deg=212), "not all round: 212° of 360° covered"),
        (scan() * 1000, "not in metres"),
        (scan()[:900], "fewer than 1,000 points: 900"),
        (np.concatenate([scan(), scan()[:2_000]]), "duplicate points: 2,000 of"),
        (scan() * (1, 1, 0), "all points in one plane"),
        (np.concatenate([scan(), np.zeros((2_000, 3))]), "points at the origin: 2,000 of"),
    ],
    ids=lambda value: value.replace(":", "") if isinstance(value, str) else "",
)
def test_each_fault_of_a_cloud_has_its_warning(points: np.ndarray, words: str) -> None:
    assert any(words in warning for warning in diagnose(points).warnings)


def test_a_cloud_squeezed_into_the_unit_cube_is_normalised() -> None:
    found = diagnose(scan() / 40)
    assert [warning.partition(":")[0] for warning in found.warnings] == ["normalised cloud"]


def test_points_that_are_not_finite_are_counted_and_left_out() -> None:
    points = scan()
    points[:7] = np.nan
    points[7] = np.inf
    found = diagnose(points)
    assert found.points == len(points) - 8
    assert f"NaN/inf points: 8 of {len(points):,}" in found.warnings[0]


@pytest.mark.parametrize("points", [0, 1, 2, 3, 5, 50, 150])
def test_a_handful_of_points_is_diagnosed_without_an_error(points: int) -> None:
    assert diagnose(scan()[:points]).points == points


def test_points_in_no_rings_have_no_beams() -> None:
    rng = np.random.default_rng(3)
    assert diagnose(rng.normal(size=(50_000, 3)) * (20, 20, 2)).beams is None


@pytest.mark.parametrize("row", [0, 9, 15])
def test_a_real_kitti_scan_has_64_beams_and_no_warning(real: Path, row: int) -> None:
    found = diagnose(Kitti().open(real / "kitti", "00").points(row))
    assert found.beams is not None
    assert abs(found.beams - 64) <= 4
    assert found.warnings == ()
    assert found.sensor_m == pytest.approx(1.9, abs=0.2)


def test_a_real_nclt_scan_has_32_beams_and_no_warning(real: Path) -> None:
    found = diagnose(
        read_velodyne_sync(real / "nclt/2012-01-15/velodyne_sync/1326652795280148.bin")
    )
    assert (found.beams, found.warnings) == (32, ())
    assert found.sensor_m == pytest.approx(0.957, abs=0.15)  # METHODS 7.1
