"""Tests that logs are opened for the estimation of poses with all scans, and without true poses."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.formats import pcd
from pipeline.formats.bag import BagWriter
from pipeline.opening.bag_contents import Contents, pose_sources
from pipeline.opening.opening import unposed
from tests.readers.bags import KINDS, START_NS, STEP_NS, bag_path, drive


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_opened_with_its_odometry_as_odometry(kind: str, tmp_path: Path) -> None:
    """Of /ground_truth in map and /odom in odom, the latter drifts; clouds lie 50 ms after the
    poses."""
    log = unposed(drive(bag_path(tmp_path, kind), kind))
    assert not np.isfinite(log.world_T_scan).any()
    assert log.stamps_ns.tolist() == [START_NS + i * STEP_NS + STEP_NS // 2 for i in range(4)]
    np.testing.assert_allclose(log.odom_T_scan[:, 0, 3], [100.5, 101.5, 102.5, 103.5], atol=1e-6)
    # (1, 2, 3) of the LiDAR, .5 m ahead, 1.5 m up, turned to the left: (.5 − 2, 1, 4.5)
    np.testing.assert_allclose(log.points(0)[1], [-1.5, 1.0, 4.5], atol=1e-6)


@pytest.mark.parametrize("name", ["/truth", "/groundtruth", "/gt_pose", "/rtk"])
def test_a_topic_named_after_the_truth_is_the_ground_truth(name: str, tmp_path: Path) -> None:
    """All poses are in one frame of no known name, so that only the topic's name decides."""
    path = bag_path(tmp_path, "ros1")
    with BagWriter(path, "ros1") as bag:
        for topic in ("/a_pose", name, "/pose"):
            bag.odometry(START_NS, "site", "base_link", np.eye(4), topic)
    ground_truth, _ = pose_sources(Contents.read([path]))
    assert ground_truth is not None
    assert ground_truth.name == name


def test_clouds_alone_are_opened_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (2, 10, 1):
        points_m = np.full((3, 3), float(number))
        (tmp_path / f"cloud_{number}.pcd").write_bytes(pcd.encode(points_m))
    log = unposed(tmp_path)
    assert log.stamps_ns.tolist() == [10**9, 2 * 10**9, 10 * 10**9]
    assert [log.points(row)[0, 0] for row in range(3)] == [1.0, 2.0, 10.0]
    assert not np.isfinite(log.odom_T_scan).any()


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "one.pcd").write_bytes(pcd.encode(np.zeros((3, 3))))
    (tmp_path / "intel.log").write_text("FLASER\n")
    for name, says in (
        ("missing", "no such file or folder"),
        ("empty", "no log"),
        ("one.pcd", "one file is no log"),
        ("intel.log", "level 2-D LiDAR"),
    ):
        with pytest.raises(LogError, match=says):
            unposed(tmp_path / name)
