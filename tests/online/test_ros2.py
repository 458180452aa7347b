"""The ROS 2 example: its logic with messages as rosbags decodes them, and its node with fakes in
place of ROS."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from pipeline.formats.bag import CLOUD, ODOMETRY, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.online.site import Site
from tests.online.made import ANCHORS, packed, scan
from tests.posing.scene import planar, scene, seen_from

NODE = Path(__file__).parents[2] / "examples/ros2/localizer.py"
START_NS = 1_700_000_000_250_000_000


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("localizer", NODE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return packed(tmp_path_factory.mktemp("site"))


def sent(folder: Path, *clouds: np.ndarray) -> tuple[list[Any], list[Any]]:
    """A cloud a second, and odometry that stands 7 m from its start and then 1 m on a second, as
    ROS delivers them."""
    with BagWriter(folder, "mcap") as bag:
        for i, points_m in enumerate(clouds):
            time_ns = START_NS + i * 10**9
            for around_ns in (-(10**8), 10**8):
                bag.odometry(
                    time_ns + around_ns,
                    "odom",
                    "base_link",
                    planar(7 + i + around_ns / 1e9, 0, 0),
                    "/wheels",
                )
            bag.points(
                time_ns,
                "lidar",
                points_m.astype(np.float32),
                np.ones(len(points_m)),
                np.zeros(len(points_m), int),
            )
    file = BagFile(folder)
    return (
        [file.decode(data, CLOUD) for _, data in file.messages("/points")],
        [file.decode(data, ODOMETRY) for _, data in file.messages("/wheels")],
    )


def faked(
    monkeypatch: pytest.MonkeyPatch, site: Path, **parameters: object
) -> dict[str, MagicMock]:
    """ROS, with these parameters of the node."""
    packages = (
        "rclpy",
        "rclpy.node",
        "rclpy.qos",
        "rclpy.utilities",
        "tf2_ros",
        "geometry_msgs",
        "nav_msgs",
        "sensor_msgs",
    )
    fakes = {
        name: MagicMock()
        for name in (*packages, "geometry_msgs.msg", "nav_msgs.msg", "sensor_msgs.msg")
    }
    for name, fake in fakes.items():
        monkeypatch.setitem(sys.modules, name, fake)
    fakes["rclpy.node"].Node.return_value.declare_parameter.side_effect = lambda name, usual: (
        SimpleNamespace(value=parameters.get(name, usual))
    )
    fakes["rclpy.utilities"].remove_ros_args.return_value = ["localizer.py", str(site)]
    return fakes


def test_an_accepted_cloud_becomes_a_pose_and_others_nothing(
    example: ModuleType, site: Path, tmp_path: Path
) -> None:
    node = example.Localizer(Site.open(site))
    elsewhere, here = map(node.pose, sent(tmp_path / "day", scene(7), scan()[0])[0])
    assert elsewhere is None
    pose, covariance, map_T_odom = here
    np.testing.assert_allclose(pose, scan()[1], atol=0.1)
    assert covariance.shape == (36,)
    assert (np.diag(covariance.reshape(6, 6)) > 0).all()
    assert np.isnan(map_T_odom).all()  # nothing is known of the odometry


def test_odometry_is_followed_and_led_to_the_map(
    example: ModuleType, site: Path, tmp_path: Path
) -> None:
    """At the second cloud, 1 m on, odometry says x = 8 m: its frame begins 8 m behind the robot."""
    node = example.Localizer(Site.open(site), body_T_lidar="0,0,1.5,180,0,0")
    mounted = [seen_from(scene(1), planar(x_m, 0, 0)) * (1, -1, -1) + (0, 0, 1.5) for x_m in (0, 1)]
    clouds, odometry = sent(tmp_path / "day", *mounted)
    steps = []
    followed = node._tracker.localize
    node._tracker.localize = lambda points_m, step, time_ns: (
        steps.append((step, time_ns)),
        followed(points_m, step, time_ns),
    )[1]
    for message in odometry:
        node.moved(message)
    _, (pose, _, map_T_odom) = map(node.pose, clouds)
    assert steps[0] == (None, START_NS)
    np.testing.assert_allclose(steps[1][0], planar(1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(pose, ANCHORS[1] @ planar(1, 0, 0), atol=0.1)
    np.testing.assert_allclose(map_T_odom, ANCHORS[1] @ planar(-7, 0, 0), atol=0.2)


def test_the_node_copies_the_stamp_and_broadcasts_the_odometrys_frame(
    example: ModuleType, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes = faked(monkeypatch, site, odometry="/wheels", tf=True)
    node = fakes["rclpy.node"].Node.return_value
    example.main()
    (_, _, arrived, _), (_, topic, moved, _) = (
        call.args for call in node.create_subscription.call_args_list
    )
    assert topic == "/wheels"
    (cloud,), odometry = sent(tmp_path / "day", scan()[0])
    for message in odometry:
        moved(message)
    arrived(cloud)
    ((fix,),) = (call.args for call in node.create_publisher.return_value.publish.call_args_list)
    assert fix.header.stamp is cloud.header.stamp
    assert (fix.header.stamp.sec, fix.header.stamp.nanosec, fix.header.frame_id) == (
        1_700_000_000,
        250_000_000,
        "map",
    )
    ((leads,),) = (
        call.args
        for call in fakes["tf2_ros"].TransformBroadcaster.return_value.sendTransform.call_args_list
    )
    assert leads.header.stamp is cloud.header.stamp
    assert (leads.header.frame_id, leads.child_frame_id) == ("map", "odom")


def test_a_promise_that_the_site_cannot_make_is_one_line(
    example: ModuleType, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faked(monkeypatch, site, promise=0.999)
    with pytest.raises(SystemExit, match="this site cannot promise that, it can"):
        example.main()
