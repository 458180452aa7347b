"""Tests the heading of a vehicle by the gyroscope of an IMU in a bag."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import pose
from pipeline.formats.bag import BagWriter
from pipeline.readers.bag import Bag
from tests.readers.bags import KINDS, START_NS, STEP_NS, bag_path, cloud

UPSIDE_DOWN = pose(np.zeros((1, 3)), np.array([[np.pi, 0.0, 0.0]]))[0]
IMU_NS = STEP_NS // 10
READER = Bag(ground_truth=None, imu="/imu")
Kind = Literal["ros1", "sqlite3", "mcap"]


def turning(path: Path, kind: Kind, seconds: tuple[tuple[float, float], ...]) -> Path:
    """A bag of ten clouds a second, and a hundred readings a second of an IMU within `seconds`.

    `seconds` are pairs of a first and a last time. The vehicle turns to the left by 0.5 rad a
    second; its IMU hangs upside down, so it reads -0.5.
    """
    with BagWriter(path, kind) as bag:
        bag.static_transform(START_NS, "lidar", "imu_link", UPSIDE_DOWN)
        for row in range(10):
            cloud(bag, START_NS + row * STEP_NS, "lidar", [[row, 0, 0], [1, 2, 3]])
        for first_s, last_s in seconds:
            for reading in range(round(first_s * 100), round(last_s * 100) + 1):
                rate_rad_s = np.array([0.0, 0.0, -0.5])
                bag.imu(START_NS + reading * IMU_NS, "imu_link", rate_rad_s)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_rates_of_turn_are_integrated_about_the_vehicles_vertical_axis(
    tmp_path: Path, kind: Kind
) -> None:
    turning(bag_path(tmp_path, kind), kind, ((0.0, 1.0),))
    log = READER.open(tmp_path, "drive")
    assert log.heading_rad is not None
    np.testing.assert_allclose(np.diff(log.heading_rad), 0.05, atol=1e-9)  # 0.5 rad/s, 0.1 s
    assert log.notes == ()
    np.testing.assert_array_equal(log.select(np.array([2, 5])).heading_rad, log.heading_rad[[2, 5]])


def test_the_heading_is_unknown_in_gaps_and_beyond_the_readings(tmp_path: Path) -> None:
    """Readings from .1 to .2 s and from .8 s on: clouds 0 and 3 to 7 have none, 8 starts again."""
    turning(bag_path(tmp_path, "mcap"), "mcap", ((0.1, 0.2), (0.8, 1.0)))
    log = READER.open(tmp_path, "drive")
    assert log.heading_rad is not None
    assert np.flatnonzero(np.isfinite(log.heading_rad)).tolist() == [1, 2, 9]


def test_an_imu_that_no_transforms_place_is_taken_for_upright(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive", "mcap") as bag:
        for row in range(3):
            stamp_ns = START_NS + row * STEP_NS
            cloud(bag, stamp_ns, "lidar", np.ones((2, 3)))
            bag.imu(stamp_ns, "imu_link", np.array([0.0, 0.0, 0.2]))
    log = READER.open(tmp_path, "drive")
    assert log.heading_rad is not None
    np.testing.assert_allclose(log.heading_rad, [0.0, 0.02, 0.04], atol=1e-9)
    assert any("its z axis is taken for up" in note for note in log.notes)


def test_what_is_no_imu_is_refused(tmp_path: Path) -> None:
    turning(bag_path(tmp_path, "mcap"), "mcap", ((0.0, 0.1),))
    with pytest.raises(LogError, match=r"reader.imu=/points is a .*PointCloud2; expected Imu"):
        Bag(ground_truth=None, imu="/points").open(tmp_path, "drive")
    with BagWriter(tmp_path / "silent", "mcap") as bag:
        cloud(bag, START_NS, "lidar", np.ones((2, 3)))
        bag.imu(START_NS, "imu_link", np.full(3, np.nan))
    with pytest.raises(LogError, match="no rate of turn"):
        READER.open(tmp_path, "silent")
