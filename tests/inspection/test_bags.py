"""Tests what `yearloc inspect` says of bags, and that the yaml it proposes opens them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import LogError, YearlocError
from pipeline.formats.bag import BagWriter
from pipeline.inspection.bag_proposal import propose
from pipeline.inspection.bags import describe_bags, proposal
from pipeline.inspection.inspection import Inspection
from pipeline.inspection.report import inspect
from pipeline.opening.bag_contents import Contents, TopicSummary
from pipeline.readers.bag import Bag
from tests.inspection.scanner import assert_says, scan
from tests.readers.bags import KINDS, START_NS, STEP_NS, at, bag_path, cloud, drive
from tests.readers.damage import damaged, one_line
from tests.readers.test_bag_fuzz import files

CONF = Path(__file__).parents[2] / "conf" / "dataset" / "bag.yaml"


def proposed(*paths: Path) -> dict:
    """The reader's settings in the yaml that is proposed, and the key `submap` of its study.

    Checks that the yaml has the keys of the project's own.
    """
    conf = yaml.safe_load(proposal(list(paths)))
    own_conf = yaml.safe_load(CONF.read_text())
    submap = conf["study"]["submap"]
    assert conf.keys() == own_conf.keys()
    assert conf["reader"].keys() == own_conf["reader"].keys()
    assert conf["study"] == own_conf["study"] | {"submap": submap}
    settings = {key: value for key, value in conf["reader"].items() if key != "_target_"}
    return settings | {"submap": submap}


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_listed_and_what_is_proposed_opens_it(tmp_path: Path, kind: str) -> None:
    path = drive(bag_path(tmp_path, kind), kind, clouds=40)
    found = inspect(path)
    assert all("looked at)" in warning for warning in found.warnings)  # of clouds of two points
    assert_says(found, "as its reader opens it", "messages  40, 40 with a true pose", "span  4 s")
    assert_says(found, "odometry  at 100 % of the messages", "/points        40        10 a second")
    assert_says(
        found, "sensor_msgs/PointCloud2, in lidar", "nav_msgs/Odometry, in map, of base_link"
    )
    assert_says(found, "base_link > lidar  1  fixed, at x 0.500, y 0.000, z 1.500 m")
    keys = proposed(path)
    assert (keys["ground_truth"], keys["odometry"], keys.pop("submap")) == (
        "/ground_truth",
        "/odom",
        "single",
    )
    assert len(Bag(**keys).open(tmp_path, "drive").stamps_ns) == 40
    assert inspect(tmp_path).sections == found.sections  # the folder that it lies in


def test_clouds_that_lie_in_the_world_already_are_refused_as_proposed(tmp_path: Path) -> None:
    """SLAM programs publish such clouds; the reader would move every point twice."""
    with BagWriter(tmp_path / "drive", "mcap") as bag:
        for i in range(20):
            bag.odometry(START_NS + i * STEP_NS, "camera_init", "body", at(i))
            cloud(bag, START_NS + i * STEP_NS, "camera_init", np.ones((5, 3)))
    found = inspect(tmp_path / "drive")
    (warning,) = found.warnings
    assert "refuses the bag as proposed" in warning
    assert "/points lies in camera_init already, the world of /odom" in warning


def test_a_cloud_in_the_robots_frame_is_proposed_before_one_in_the_world(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive", "mcap") as bag:
        for i in range(20):
            bag.odometry(START_NS + i * STEP_NS, "map", "body", at(i))
            for topic, frame in (("/a_map", "map"), ("/body", "body")):
                cloud(bag, START_NS + i * STEP_NS, frame, np.ones((5, 3)), topic=topic)
    assert proposed(tmp_path / "drive")["points"] == "/body"


def test_a_warning_says_that_a_large_bag_was_not_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.inspection.bags.MAX_TRIED_BYTES", 100)
    (warning,) = inspect(drive(tmp_path / "drive", "mcap")).warnings
    assert warning.startswith("not tried: ")


def test_the_proposal_can_be_pasted_from_a_terminal_of_any_width(tmp_path: Path) -> None:
    path = drive(bag_path(tmp_path, "mcap"), "mcap", clouds=2)
    for width in (40, 118, 10_000):
        shown = inspect(path).text(width)
        pasted = shown.partition("bags lie in\n")[2].partition("\n\n")[0]
        assert yaml.safe_load(pasted) == yaml.safe_load(proposal([path]))


def test_the_ground_of_the_first_cloud_is_lifted_to_zero(tmp_path: Path) -> None:
    # The scanner stands 1.8 m over the ground; base_link is its frame.
    with BagWriter(tmp_path / "drive", "mcap") as bag:
        for i in range(3):
            bag.odometry(START_NS + i * STEP_NS, "map", "base_link", at(i))
            cloud(bag, START_NS + i * STEP_NS, "base_link", scan() - (0, 0, 1.8))
    keys = proposed(tmp_path / "drive")
    assert keys.pop("submap") == "single"
    assert keys["lift_m"] == pytest.approx(1.8, abs=0.05)
    log = Bag(**keys).open(tmp_path, "drive")
    assert np.percentile(log.points(1)[:, 2], 1) == pytest.approx(0, abs=0.1)


def test_transforms_serve_where_no_topic_does(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive.bag", "ros1") as bag:
        for i in range(4):
            side = np.eye(4)
            side[1, 3] = 0.1 * i
            bag.transform(START_NS + i * STEP_NS, "map", "odom", side)
            bag.transform(START_NS + i * STEP_NS, "odom", "base_link", at(i))
            bag.static_transform(START_NS, "base_link", "laser", at(1))
            bag.laser_scan(START_NS + i * STEP_NS, "laser", np.ones(9), 0, 0.1, 0.1, 30)
    keys = proposed(tmp_path / "drive.bag")
    assert (keys.pop("submap"), keys["points"]) == ("flat", "/scan")
    assert (keys["ground_truth"], keys["odometry"]) == ("tf:map>base_link", "tf:odom>base_link")
    log = Bag(**keys).open(tmp_path, "drive")
    np.testing.assert_allclose(
        log.world_T_scan[:, :2, 3], [[i, 0.1 * i] for i in range(4)], atol=1e-12
    )


def test_warnings_say_that_poses_drift_and_extrinsics_are_missing(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive.bag", "ros1") as bag:
        bag.odometry(START_NS, "odom", "base_link", at(0))
        cloud(bag, START_NS, "os_lidar", np.ones((2, 3)))
    drift, extrinsic = inspect(tmp_path / "drive.bag").warnings
    assert drift.startswith("the only poses are in the frame odom, which starts again")
    assert "poses=slam" in drift
    assert extrinsic.startswith("no fixed transforms lead from base_link to os_lidar: give x, y, z")
    reader = proposed(tmp_path / "drive.bag")
    assert (reader["ground_truth"], reader["odometry"]) == (None, "/odom")


def test_a_bag_without_points_says_what_it_holds(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive.bag", "ros1") as bag:
        bag.odometry(START_NS, "odom", "base_link", at(0))
    (warning,) = inspect(tmp_path / "drive.bag").warnings
    assert "neither a PointCloud2 nor a LaserScan in it; it holds /odom" in warning
    with pytest.raises(LogError, match="neither a PointCloud2"):
        proposal([tmp_path / "drive.bag"])
    with pytest.raises(LogError, match="no bag there"):
        proposal([tmp_path / "other"])


def test_real_bags_are_described_with_what_they_lack(real: Path) -> None:
    found = inspect(real / "bags" / "laserscan_rosbag1_v2.0.bag")
    assert_says(
        found, "/scan  360       10.1 a second  sensor_msgs/LaserScan, in laser", "span  35.8 s"
    )
    assert found.warnings[0].startswith("no poses: sweeps of a 2-D LiDAR need an Odometry")
    assert found.warnings[0].endswith("Topics here: /scan (sensor_msgs/LaserScan)")
    assert proposed(real / "bags" / "laserscan_rosbag1_v2.0.bag")["ground_truth"] is None
    warnings = inspect(real / "bags").warnings
    assert sum(warning.startswith("left aside") for warning in warnings) == 2
    refusals = {"rosbag1_bad_index": "cannot be read as a bag", "rosbag_v1.2": "of version 1.2"}
    for name, says in refusals.items():
        with one_line(LogError, says):
            inspect(real / "bags" / f"laserscan_{name}.bag")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("whole")
    return [drive(bag_path(root / kind, kind), kind, clouds=1) for kind in KINDS]


@given(data=st.data())
@settings(max_examples=100, derandomize=True)
def test_a_damaged_bag_is_described_or_refused(whole: list[Path], data: st.DataObject) -> None:
    path = data.draw(st.sampled_from(whole))
    file = data.draw(st.sampled_from(files(path)))
    sound = file.read_bytes()
    file.write_bytes(data.draw(damaged(sound)))
    try:
        describe_bags(path, found := Inspection(path))
        assert found.text()
        assert isinstance(yaml.safe_load(proposal([path])), dict)
    except YearlocError as error:
        refused = str(error)
    else:
        return
    finally:
        file.write_bytes(sound)
    assert "\n" not in refused


@pytest.mark.parametrize(
    "kind", ["livox_ros_driver2/msg/CustomMsg", "velodyne_msgs/msg/VelodyneScan"]
)
def test_packets_of_a_lidar_are_sent_to_its_driver(tmp_path: Path, kind: str) -> None:
    packed = TopicSummary("/lidar", kind, 5, 10.0, "", "")
    contents = replace(Contents.read([drive(tmp_path / "drive.bag", "ros1")]), topics=(packed,))
    with pytest.raises(LogError, match=f"make PointCloud2 of {kind} while `ros2 bag record` runs"):
        propose(contents)
