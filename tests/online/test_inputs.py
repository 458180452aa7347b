"""The points of a scan are moved to where they lay at its stamp, whatever it is read from."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.formats import pcd
from pipeline.formats.bag import BagWriter
from pipeline.formats.folder import SCAN_FOLDERS
from pipeline.online.follow import Following
from pipeline.online.inputs import Scan, ScanOptions
from pipeline.opening.opening import unposed
from tests.posing.scene import planar
from tests.readers.bags import START_NS, STEP_NS, cloud

READER = {"_target_": "pipeline.readers.bag.Bag", "ground_truth": None, "odometry": "/wheels"}
"""The reader of a site whose data set is bags with estimated poses."""
OTHER = {"_target_": "pipeline.readers.carmen.Carmen"}
"""The reader of a site whose data set is of another kind."""


def opened(source: Path, reader: dict[str, Any], **options: Any) -> Iterator[Scan]:
    """The scans at a path, for a site of this reader."""
    return ScanOptions(reader, **options).scans(str(source), Counter())


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag of a robot that drives at 10 m/s along x.

    Each cloud has two points 3 m ahead of the robot, one at the stamp and one .05 s later. So the
    second lies 3.5 m ahead of where the robot was at the stamp.
    """
    with BagWriter(tmp_path / "day", "mcap") as writer:
        for row in range(-2, 5):
            stamp_ns = START_NS + row * STEP_NS
            writer.odometry(stamp_ns, "odom", "base_link", planar(row, 0, 0), "/wheels")
        for row in range(3):
            points_m = [[3, 0, 0], [3, 0, 0]]
            times_s = np.array([0.0, 0.05])
            cloud(writer, START_NS + row * STEP_NS, "base_link", points_m, times_s=times_s)
    return tmp_path / "day"


def test_the_points_of_a_bag_are_moved_by_its_odometry(bag: Path) -> None:
    for scan in opened(bag, OTHER, odometry="/wheels"):
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)


def test_the_points_of_a_log_of_the_sites_data_set_are_moved_too(bag: Path) -> None:
    found = list(opened(bag, READER))
    assert found[0].body_T_lidar is None  # its reader placed them
    for scan in found:
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)


def test_without_odometry_points_stay_where_they_were_measured(bag: Path) -> None:
    for scan in opened(bag, OTHER):
        np.testing.assert_array_equal(scan.points()[:, 0], [3.0, 3.0])


def test_the_points_of_a_followed_recording_are_moved_by_the_motion_before_the_stamp(
    bag: Path,
) -> None:
    (file,) = bag.glob("*.mcap")
    for scan in Following(file, ScanOptions(OTHER, odometry="/wheels"), 0.3).scans():
        np.testing.assert_allclose(scan.points()[:, 0], [3.0, 3.5], atol=0.02)


def test_of_several_bags_the_topic_with_most_clouds_in_all_is_read(tmp_path: Path) -> None:
    """Four clouds in front and three behind, of which the later bag has one and two."""
    counts = {"first": {"/front": 3, "/rear": 1}, "later": {"/front": 1, "/rear": 2}}
    stamp_ns = START_NS
    for folder, counts_by_topic in counts.items():
        with BagWriter(tmp_path / "day" / folder, "mcap") as writer:
            for topic, count in counts_by_topic.items():
                for _ in range(count):
                    stamp_ns += STEP_NS
                    cloud(writer, stamp_ns, "base_link", np.ones((2, 3)), topic=topic)
    assert len(list(opened(tmp_path / "day", OTHER))) == 4


@pytest.mark.parametrize("name", SCAN_FOLDERS)
def test_scans_in_a_subfolder_are_opened_to_localise_and_to_estimate_poses(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "7.pcd").write_bytes(pcd.encode(np.ones((3, 3))))
    (scan,) = opened(tmp_path, OTHER)
    np.testing.assert_array_equal(scan.points(), np.ones((3, 3)))
    if name != "velodyne_sync":  # NCLT's: a log of that data set
        log = unposed(tmp_path)
        np.testing.assert_array_equal(log.points(0), np.ones((3, 3)))


def mounted(folder: Path, topic: str, **transforms: np.ndarray) -> Path:
    """A bag with a cloud of one point, 1 m ahead of `laser`, whose transforms are on `topic`.

    They lead from base_link to each of `transforms`, and are sent twice, before and after it.
    """
    with BagWriter(folder, "mcap") as writer:
        for stamp_ns in (START_NS, START_NS + 2 * STEP_NS):
            for child, base_T_child in transforms.items():
                writer.transform(stamp_ns, "base_link", child, base_T_child, topic)
        cloud(writer, START_NS + STEP_NS, "laser", [[1, 0, 0]])
    return folder


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_a_lidar_is_placed_by_fixed_transforms_wherever_they_are_sent(
    tmp_path: Path, topic: str
) -> None:
    """The laser sits 0.3 m behind base_link and looks backward: the point is at -1.3 m."""
    bag = mounted(tmp_path / "day", topic, laser=planar(-0.3, 0, 180))
    (file,) = bag.glob("*.mcap")
    (localized,) = opened(bag, OTHER)
    (followed,) = Following(file, ScanOptions(OTHER), 0.3).scans()
    estimated = unposed(bag).points(0)
    for points_m in (localized.points(), followed.points(), estimated):
        np.testing.assert_allclose(points_m, [[-1.3, 0, 0]], atol=1e-6)


def test_a_lidar_that_no_transform_places_on_the_vehicle_is_refused(tmp_path: Path) -> None:
    bag = mounted(tmp_path / "day", "/tf_static", camera=planar(0.3, 0, 0))
    (file,) = bag.glob("*.mcap")
    says = "no fixed transforms lead from base_link to laser, .* give --body-T-lidar"
    with pytest.raises(LogError, match=says):
        next(opened(bag, OTHER))
    with pytest.raises(LogError, match=says):
        next(Following(file, ScanOptions(OTHER), 0.3).scans())
    (scan,) = opened(bag, OTHER, body_T_lidar=planar(0, 2, 0))
    np.testing.assert_allclose(scan.points(), [[1, 2, 0]], atol=1e-6)


def test_without_transforms_the_lidar_is_the_vehicle(tmp_path: Path) -> None:
    (scan,) = opened(mounted(tmp_path / "day", "/tf"), OTHER, lift_m=0.5)
    np.testing.assert_allclose(scan.points(), [[1, 0, 0.5]], atol=1e-6)


def test_a_lidar_that_nothing_places_on_the_frame_of_the_odometry_is_refused_or_said(
    tmp_path: Path,
) -> None:
    with BagWriter(tmp_path / "day", "mcap") as writer:
        for row in range(3):
            stamp_ns = START_NS + row * STEP_NS
            writer.odometry(stamp_ns, "odom", "base_link", planar(row, 0, 0), "/odom")
            cloud(writer, stamp_ns, "laser", [[1, 0, 0]])
    with pytest.raises(LogError, match=r"lead from base_link to laser, .* give --body-T-lidar"):
        next(opened(tmp_path / "day", OTHER, odometry="/odom"))
    assert len(list(opened(tmp_path / "day", OTHER))) == 3
    (note,) = unposed(tmp_path / "day").notes
    assert "from base_link of /odom to laser: the LiDAR is taken for the vehicle" in note
