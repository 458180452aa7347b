"""The points of queries as they lay at the stamp of their scan."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.formats.bag import BagWriter
from pipeline.online.follow import Following
from pipeline.online.inputs import scans
from tests.posing.scene import planar

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
READER = {"_target_": "pipeline.readers.bag.Bag", "truth": None, "odometry": "/wheels"}
"""Of a data set of bags whose poses are estimated."""
OTHER = {"_target_": "pipeline.readers.carmen.Carmen"}
"""Of a data set of another kind."""


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag driven at 10 m/s along x.

    Its clouds have a point 3 m ahead at the stamp, and another, of .05 s later, 3 m ahead of where
    the robot was then: 3.5 m ahead of the stamp's place.
    """
    with BagWriter(tmp_path / "day", "mcap") as writer:
        for row in range(-2, 5):
            stamp_ns = START_NS + row * STEP_NS
            writer.odometry(stamp_ns, "odom", "base_link", planar(row, 0, 0), "/wheels")
        for row in range(3):
            writer.points(
                START_NS + row * STEP_NS,
                "base_link",
                np.array([[3, 0, 0], [3, 0, 0]], np.float32),
                np.ones(2),
                np.zeros(2, int),
                times_s=np.array([0.0, 0.05]),
            )
    return tmp_path / "day"


def test_a_bag_s_points_are_moved_to_where_they_lay_at_the_stamp(bag: Path) -> None:
    for scan in scans(str(bag), OTHER, 0.0, odometry="/wheels"):
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)


def test_those_of_a_log_of_the_site_s_data_set_too(bag: Path) -> None:
    opened = list(scans(str(bag), READER, 0.0))
    assert opened[0].body_T_lidar is None  # its reader placed them
    for scan in opened:
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)


def test_without_odometry_they_stay(bag: Path) -> None:
    for scan in scans(str(bag), OTHER, 0.0):
        np.testing.assert_array_equal(scan.points()[:, 0], [3.0, 3.0])


def test_those_of_a_recording_that_is_followed_are_moved_by_the_motion_before(bag: Path) -> None:
    (file,) = bag.glob("*.mcap")
    for scan in Following(file, None, 0.0, 0.3, "/wheels").scans():
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)
