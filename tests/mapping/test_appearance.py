"""What submaps look like, measured on made-up scenes."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import pose
from pipeline.mapping.appearance import is_level, measure_appearance
from tests.views.made import artifacts

RNG = np.random.default_rng(0)


def looks(folder: Path, points: np.ndarray) -> dict[str, float]:
    """The appearance of twenty submaps of one scan each, all with the same points."""
    poses = pose(np.arange(20)[:, None] * (1.0, 0, 0), np.zeros((20, 3)))
    scans, _ = artifacts(folder, [points] * 20, poses)
    rows = np.arange(20)
    return measure_appearance(scans, "world_T_scan", rows, rows, np.zeros(20), np.ones(20, bool))


def test_an_open_square_with_a_wall(tmp_path: Path) -> None:
    # A floor 0.3 m below 0 in front, from −60° to 60°, and a wall up to 5 m on it.
    azimuth = np.radians(np.linspace(-60, 60, 2000))
    range_m = RNG.uniform(3, 14, 2000)
    floor = np.column_stack(
        [range_m * np.cos(azimuth), range_m * np.sin(azimuth), np.full(2000, -0.3)]
    )
    wall = np.column_stack([np.full(500, 14.0), np.zeros(500), np.linspace(0, 5, 500)])
    found = looks(tmp_path, np.concatenate([floor, wall]))
    assert found == pytest.approx(
        {"azimuth_deg": 120, "ground_m": -0.3, "highest_m": 4.75}, abs=0.05
    )


def test_ground_that_was_cut_off_is_not_found_higher_up(tmp_path: Path) -> None:
    """A wall from .3 m up has 200 points, a canopy at 3 m 400: a third lie far below the canopy."""
    wall = np.column_stack([np.full(200, 6.0), np.zeros(200), np.linspace(0.3, 2, 200)])
    x, y = np.meshgrid(np.linspace(-5, 5, 20), np.linspace(-5, 5, 20))
    canopy = np.column_stack([x.ravel(), y.ravel(), np.full(400, 3.0)])
    assert np.isnan(looks(tmp_path, np.concatenate([wall, canopy]))["ground_m"])


def test_a_level_laser_has_no_ground(tmp_path: Path) -> None:
    azimuth = np.radians(np.arange(360))
    found = looks(
        tmp_path, np.column_stack([5 * np.cos(azimuth), 5 * np.sin(azimuth), np.full(360, 0.4)])
    )
    assert found == pytest.approx(
        {"azimuth_deg": 360, "ground_m": np.nan, "highest_m": 0.4}, abs=0.01, nan_ok=True
    )


def test_scans_without_a_point_have_no_looks(tmp_path: Path) -> None:
    found = looks(tmp_path, np.empty((0, 3)))
    assert list(found) == ["azimuth_deg", "ground_m", "highest_m"]
    assert np.isnan(list(found.values())).all()


def test_a_scan_of_rings_is_no_sweep_although_each_ring_is_flat() -> None:
    """Of 64,000 points of 32 rings in turn, every 32nd lies on the ring at the sensor's height."""
    elevation = np.tile(np.deg2rad(np.linspace(-20, 11, 32)), 2000)
    elevation -= elevation[0]
    azimuth = np.repeat(np.linspace(0, 2 * np.pi, 2000), 32)
    rings = 10 * np.column_stack([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)])
    assert not is_level([rings])
    assert is_level([rings[::32]])
    assert not is_level([rings[::32], rings, rings])  # most are not
    assert not is_level([])


def test_a_tilted_laser_is_level_too() -> None:
    azimuth = np.linspace(0, np.pi, 180)
    sweep = 5 * np.column_stack([np.cos(azimuth), np.sin(azimuth), 0.1 * np.sin(azimuth)])
    assert is_level([sweep])
