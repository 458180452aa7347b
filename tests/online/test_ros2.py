"""The ROS 2 example: its logic with messages decoded by rosbags, and its node with ROS faked."""

import importlib.util
import sys
from array import array
from itertools import chain
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.formats.bag import CLOUD, ODOMETRY, POSE_COVARIANCE, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.online.level_pack import pack_map
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from tests.level.hall import map_of_hall, sweep
from tests.online.made import ANCHORS, scan
from tests.posing.scene import planar, scene, seen_from
from tests.readers.bags import cloud
from tests.readers.damage import one_line

NODE = Path(__file__).parents[2] / "examples/ros2/localizer.py"
START_NS = 1_700_000_000_250_000_000


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """The module of the example, which is in no package."""
    spec = importlib.util.spec_from_file_location("localizer", NODE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sent(folder: Path, *clouds: np.ndarray) -> tuple[list[Any], list[Any]]:
    """The messages of clouds, one a second, and of odometry, as ROS delivers them.

    By odometry the robot is 7 m from its start at the first cloud, and drives at 1 m/s.
    """
    with BagWriter(folder, "mcap") as bag:
        for i, points_m in enumerate(clouds):
            time_ns = START_NS + i * 10**9
            for around_ns in (-(10**8), 10**8):
                odom_T_robot = planar(7 + i + around_ns / 1e9, 0, 0)
                bag.odometry(time_ns + around_ns, "odom", "base_link", odom_T_robot, "/wheels")
            cloud(bag, time_ns, "lidar", points_m)
    file = BagFile(folder)
    return (
        [file.decode(data, CLOUD) for _, data in file.messages("/points")],
        [file.decode(data, ODOMETRY) for _, data in file.messages("/wheels")],
    )


def faked(
    monkeypatch: pytest.MonkeyPatch, site: Path, **parameters: object
) -> dict[str, MagicMock]:
    """Put fakes in place of the modules of ROS, with these parameters of the node."""
    ros = ("rclpy", "rclpy.node", "rclpy.qos", "rclpy.utilities", "tf2_ros")
    messages = [(name, f"{name}.msg") for name in ("geometry_msgs", "nav_msgs", "sensor_msgs")]
    fakes = {name: MagicMock() for name in (*ros, *chain(*messages))}
    for name, fake in fakes.items():
        monkeypatch.setitem(sys.modules, name, fake)
    fakes["rclpy.node"].Node.return_value.declare_parameter.side_effect = lambda name, usual: (
        SimpleNamespace(value=parameters.get(name, usual))
    )
    fakes["rclpy.utilities"].remove_ros_args.return_value = ["localizer.py", str(site)]
    return fakes


def test_only_an_accepted_cloud_becomes_a_pose(
    example: ModuleType, three_places: Path, tmp_path: Path
) -> None:
    node = example.Localizer(Site.open(three_places))
    elsewhere, here = map(node.pose, sent(tmp_path / "day", scene(7), scan()[0])[0])
    assert elsewhere is None
    np.testing.assert_allclose(here.map_T_body, scan()[1], atol=0.1)
    assert (np.diag(here.covariance.reshape(6, 6)) > 0).all()
    assert np.isnan(here.map_T_odom).all()  # there was no odometry


def test_the_odometrys_frame_is_located_in_the_map(
    example: ModuleType, three_places: Path, tmp_path: Path
) -> None:
    """At the second cloud, 1 m farther on, odometry is at x = 8 m, so it began 8 m behind the
    robot."""
    node = example.Localizer(Site.open(three_places), body_T_lidar="0,0,1.5,180,0,0")
    mounted = [seen_from(scene(1), planar(x_m, 0, 0)) * (1, -1, -1) + (0, 0, 1.5) for x_m in (0, 1)]
    clouds, odometry = sent(tmp_path / "day", *mounted)
    for message in odometry:
        node.moved(message)
    _, here = map(node.pose, clouds)
    np.testing.assert_allclose(here.map_T_body, ANCHORS[1] @ planar(1, 0, 0), atol=0.1)
    np.testing.assert_allclose(here.map_T_odom, ANCHORS[1] @ planar(-7, 0, 0), atol=0.2)


def test_the_node_copies_the_stamp_and_broadcasts_where_the_odometrys_frame_is(
    example: ModuleType, three_places: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes = faked(monkeypatch, three_places, odometry="/wheels", tf=True)
    node = fakes["rclpy.node"].Node.return_value
    example.main()
    (_, _, arrived, _), (_, topic, moved, _), _ = (
        call.args for call in node.create_subscription.call_args_list
    )
    assert topic == "/wheels"
    (cloud,), odometry = sent(tmp_path / "day", scan()[0])
    for message in odometry:
        moved(message)
    arrived(cloud)
    ((fix,),) = (call.args for call in node.create_publisher.return_value.publish.call_args_list)
    assert fix.header.stamp is cloud.header.stamp
    assert (fix.header.stamp.sec, fix.header.stamp.nanosec) == (1_700_000_000, 250_000_000)
    assert fix.header.frame_id == "map"
    ((leads,),) = (
        call.args
        for call in fakes["tf2_ros"].TransformBroadcaster.return_value.sendTransform.call_args_list
    )
    assert leads.header.stamp is cloud.header.stamp
    assert (leads.header.frame_id, leads.child_frame_id) == ("map", "odom")


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A level site of the hall."""
    path = map_of_hall(tmp_path_factory.mktemp("hall"))
    pack_map(path, path.with_name("hall.site"))
    return path.with_name("hall.site")


def stamped(row: int, **fields: object) -> SimpleNamespace:
    """A message stamped at second 1 + row, in the frame of the odometry."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1 + row, nanosec=0), frame_id="odom")
    return SimpleNamespace(header=header, **fields)


def laser_scan(row: int, x_m: float, y_m: float, heading_rad: float) -> SimpleNamespace:
    """The message of a laser .5 m ahead of a robot."""
    laser = (x_m + 0.5 * np.cos(heading_rad), y_m + 0.5 * np.sin(heading_rad), heading_rad)
    ranges_m = np.linalg.norm(sweep(*laser, beams=181), axis=1)
    angles = {"angle_min": -np.pi / 2, "angle_increment": np.pi / 180}
    return stamped(row, ranges=array("f", ranges_m), range_min=0.1, range_max=30.0, **angles)


STANDS = SimpleNamespace(
    position=SimpleNamespace(x=0.0, y=0.0, z=0.0),
    orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
)


def test_a_level_robot_is_started_once_and_again_after_it_was_carried_away(
    example: ModuleType, hall: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot is carried away at the fifth sweep, and by odometry stands still all the time.

    Three sweeps fail before the whole map is searched again.
    """
    fakes = faked(
        monkeypatch, hall, odometry="/wheels", target_precision=0.95, body_T_lidar="0.5,0,0,0,0,0"
    )
    node = fakes["rclpy.node"].Node.return_value
    publishers: dict[str, MagicMock] = {}
    node.create_publisher.side_effect = lambda _, topic, __: publishers.setdefault(
        topic, MagicMock()
    )
    example.main()
    (kind, topic, arrived, _), (_, _, moved, _), (_, _, believed, _) = (
        call.args for call in node.create_subscription.call_args_list
    )
    assert kind is fakes["sensor_msgs.msg"].LaserScan
    assert topic == "scan"
    tracker = MagicMock()
    places = [(16.0, 6.0, 2.0)] * 4 + [(3.0, 4.0, 0.5)] * 10
    poses = []
    for row, place in enumerate(places):
        pose = SimpleNamespace(pose=STANDS)
        moved(stamped(row, child_frame_id="base_link", pose=pose))
        message = fakes["geometry_msgs.msg"].PoseWithCovarianceStamped.return_value = MagicMock()
        arrived(laser_scan(row, *place))
        poses.append(message)
    initial = [call.args[0] for call in publishers["/initialpose"].publish.call_args_list]
    numbers = [next(i for i, pose in enumerate(poses) if pose is each) for each in initial]
    assert numbers[0] < 4
    assert len(numbers) == 2
    for message, (x_m, y_m, heading_rad) in zip(initial, (places[0], places[-1]), strict=True):
        position = message.pose.pose.position
        turn = message.pose.pose.orientation
        assert np.hypot(position.x - x_m, position.y - y_m) < 0.1
        assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(heading_rad, abs=0.03)
        # x, y and heading lie at these three of AMCL's 36 numbers
        assert all(0 < message.pose.covariance[number] < 1 for number in (0, 7, 35))
        assert message.header.frame_id == "map"
    # the node's own pose comes back on the topic, and starts no new track
    with monkeypatch.context() as patched:
        patched.setattr(Tracker, "restart", tracker)
        own = stamped(places.index(places[-1]) + len(places), pose=STANDS)
        own.header.stamp = initial[-1].header.stamp
        own.header.frame_id = "map"
        believed(own)
    tracker.assert_not_called()


def test_a_pose_that_a_person_gives_is_the_prior_of_the_next_scan(
    example: ModuleType, three_places: Path, tmp_path: Path
) -> None:
    node = example.Localizer(Site.open(three_places), 0.95)
    (before, after), _ = sent(tmp_path / "day", scan(1)[0], scan(2)[0])
    assert node.pose(before) is not None
    x_m, y_m = scan(2)[1][:2, 3]
    node.believed(initial_pose(tmp_path / "given", x_m, y_m, np.diag([4, 4, 0, 0, 0, 1.0])))
    here = node.pose(after)
    assert here.is_initial
    np.testing.assert_allclose(here.map_T_body, scan(2)[1], atol=0.1)
    node.believed(initial_pose(tmp_path / "zeros", x_m, y_m, np.zeros((6, 6))))
    assert node.pose(after) is not None
    with one_line(InputError, "a variance of -1"):
        node.believed(initial_pose(tmp_path / "none", x_m, y_m, -np.eye(6)))
    with one_line(InputError, "a pose in 'map': expected 'odom'"):
        node.believed(initial_pose(tmp_path / "odom", x_m, y_m, np.eye(6)), "odom")


def initial_pose(folder: Path, x_m: float, y_m: float, covariance: np.ndarray) -> Any:
    """A PoseWithCovarianceStamped with a heading of 0, as ROS delivers it."""
    with BagWriter(folder, "mcap") as bag:
        pose = planar(x_m, y_m, 0)
        bag.pose_with_covariance(START_NS + 10**8, "map", pose, covariance, "/initialpose")
    file = BagFile(folder)
    return file.decode(file.first("/initialpose") or b"", POSE_COVARIANCE)
