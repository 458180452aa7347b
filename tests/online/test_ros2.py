"""The ROS 2 example's logic, without ROS: messages as rosbags decodes them."""

import importlib.util
from pathlib import Path

import numpy as np

from pipeline.formats.bag import CLOUD, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.online.site import Site
from tests.online.made import packed, scan
from tests.posing.scene import scene

NODE = Path(__file__).parents[2] / "examples/ros2/localizer.py"


def test_an_accepted_cloud_becomes_a_pose_and_others_nothing(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("localizer", NODE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    node = example.Localizer(Site.open(packed(tmp_path)))
    with BagWriter(tmp_path / "day", "mcap") as bag:
        for i, points_m in enumerate((scene(7), scan()[0])):
            bag.points(10**18 + i, "lidar", points_m.astype(np.float32), np.ones(len(points_m)), np.zeros(len(points_m), int))
    bag_file = BagFile(tmp_path / "day")
    elsewhere, here = (node.pose(bag_file.decode(data, CLOUD)) for _, data in bag_file.messages("/points"))
    assert elsewhere is None
    pose, covariance = here
    np.testing.assert_allclose(pose, scan()[1], atol=0.1)
    assert covariance.shape == (36,)
    assert (np.diag(covariance.reshape(6, 6)) > 0).all()


def test_the_node_is_short() -> None:
    assert len(NODE.read_text().splitlines()) <= 80
