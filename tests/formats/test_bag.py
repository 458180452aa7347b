"""Tests the writer of bags and the decoding of ROS messages.

Bags have the same bytes each time and can be read by rosbags alone; messages are made by hand.
"""

import struct
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD, ODOMETRY, SWEEP, BagWriter, typestore
from pipeline.formats.messages import header, poses, sweep_points
from pipeline.formats.pointcloud2 import decode
from tests.readers.bags import KINDS, START_NS, at, bag_path, drive
from tests.readers.by_hand import Cdr, ros1_header


def contents(path: Path) -> dict[str, bytes]:
    """The bytes of each file of a bag, by its name."""
    files = [path] if path.is_file() else sorted(path.iterdir())
    return {file.name: file.read_bytes() for file in files}


@pytest.mark.parametrize("kind", KINDS)
def test_a_bags_bytes_do_not_depend_on_the_clock_and_it_is_never_written_over(
    tmp_path: Path, kind: str
) -> None:
    path = drive(bag_path(tmp_path / "a", kind), kind)
    first = contents(path)
    time.sleep(1.1)
    assert contents(drive(bag_path(tmp_path / "b", kind), kind)) == first
    with pytest.raises(LogError, match="exists already"):
        BagWriter(path, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_read_by_its_own_definitions(tmp_path: Path, kind: str) -> None:
    path = bag_path(tmp_path, kind)
    with BagWriter(path, kind) as bag:
        bag.points(
            START_NS + 7,
            "lidar",
            np.array([[1, 2, 3], [4, 5, 6]], np.float32),
            np.array([7, 8]),
            np.array([0, 31]),
        )
        bag.odometry(START_NS + 8, "map", "base_link", at(2, np.pi / 2))
        bag.laser_scan(START_NS + 9, "laser", np.array([1.0, 2.0]), -0.5, 0.25, 0.1, 30.0)
    with AnyReader([path]) as reader:
        found = {
            c.msgtype: (stamp, reader.deserialize(data, c.msgtype))
            for c, stamp, data in reader.messages()
        }
    stamp_ns, cloud = found[CLOUD]
    assert (stamp_ns, cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (
        START_NS + 7,
        START_NS // 10**9,
        7,
    )
    assert (cloud.header.frame_id, cloud.width, cloud.point_step) == ("lidar", 2, 20)
    # x, y, z, intensity as float32, ring as uint16, two bytes of padding.
    assert bytes(cloud.data) == struct.pack("<4fHxx4fHxx", 1, 2, 3, 7, 0, 4, 5, 6, 8, 31)
    np.testing.assert_array_equal(decode(cloud), [[1, 2, 3], [4, 5, 6]])
    pose = found[ODOMETRY][1].pose.pose
    assert (pose.position.x, found[ODOMETRY][1].child_frame_id) == (2, "base_link")
    assert (pose.orientation.z, pose.orientation.w) == pytest.approx((0.5**0.5, 0.5**0.5))
    sweep = found[SWEEP][1]
    assert (sweep.angle_min, sweep.angle_max, sweep.ranges.tolist()) == (-0.5, -0.25, [1, 2])


def test_a_header_is_found_in_both_wire_formats() -> None:
    stamp_ns = 1_326_030_975_000_000_123
    for big in (False, True):
        cdr = Cdr(big)
        cdr.header(stamp_ns, "velodyne")
        assert header(cdr.data + b"more", ros=2) == (stamp_ns, "velodyne")
    assert header(ros1_header(stamp_ns, "/velodyne") + b"more", ros=1) == (stamp_ns, "velodyne")


@pytest.mark.parametrize(
    ("data", "ros", "says"),
    [
        (b"", 1, "without a whole header"),
        (bytes(15), 1, "without a whole header"),
        (bytes(4) + struct.pack("<III", 1, 2, 5) + b"four", 1, "without a whole header"),
        (bytes(4) + struct.pack("<III", 1, 2, 2**32 - 1) + b"four", 1, "without a whole header"),
        (bytes(4) + struct.pack("<III", 1, 2, 2) + b"\xff\xfe", 1, "without a whole header"),
        (bytes(4) + struct.pack("<III", 1, 10**9, 0), 1, "which is no time"),
        (b"\0\1\0\0" + struct.pack("<iII", -1, 0, 1) + b"\0", 2, "which is no time"),  # before 1970
    ],
)
def test_a_header_that_is_cut_short_or_has_no_valid_time_is_refused(
    data: bytes, ros: int, says: str
) -> None:
    with pytest.raises(LogError, match=says):
        header(data, ros)


def test_only_a_position_on_earth_with_a_rotation_is_a_pose() -> None:
    half = 0.5**0.5
    nan = float("nan")
    rows = [
        (1, 2, 3, 0, 0, half, half),
        (nan, 0, 0, 0, 0, 0, 1),
        (0, 0, 0, 0, 0, 0, 0),
        (0, 0, 0, nan, 0, 0, 1),
        (1e300, 0, 0, 0, 0, 0, 1),
    ]
    found = poses(rows)
    np.testing.assert_allclose(
        found[0], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12
    )
    assert np.isnan(found[1:]).all()
    assert poses([]).shape == (0, 4, 4)


def test_a_laser_scan_from_bytes_made_by_hand() -> None:
    # Five beams from 90° down to −90° in steps of −45°: none, too near, 2 m at 0°, too far, 4 m at
    # −90°.
    cdr = Cdr(big=False)
    cdr.header(5, "laser")
    cdr.add("f", np.pi / 2, -np.pi / 2, -np.pi / 4, 0, 0, 0.5, 10.0)
    cdr.add("I", 5)
    cdr.add("f", float("nan"), 0.25, 2.0, 11.0, 4.0)
    cdr.add("I", 0)
    found = sweep_points(typestore(2).deserialize_cdr(cdr.data, SWEEP))
    np.testing.assert_allclose(found, [[2, 0, 0], [0, -4, 0]], atol=1e-6)


@pytest.mark.parametrize(
    "far", [float("inf"), 0.0, float("nan")], ids=["infinite", "left out", "not a number"]
)
def test_a_limit_that_is_none_leaves_every_finite_range(far: float) -> None:
    sizes = {"angle_min": 0.0, "angle_increment": np.pi / 2, "range_min": 0.1, "range_max": far}
    found = sweep_points(
        SimpleNamespace(**sizes, ranges=np.array([2, np.inf, 300, 0.05], np.float32))
    )
    np.testing.assert_allclose(found, [[2, 0, 0], [-300, 0, 0]], atol=1e-4)


@pytest.mark.parametrize(
    "wrong", [{"angle_min": float("nan")}, {"angle_increment": float("inf")}, {"angle_min": 1e30}]
)
def test_a_laser_scan_of_no_scanner_is_refused(wrong: dict[str, float]) -> None:
    sizes = {"angle_min": 0.0, "angle_increment": 0.1, "range_min": 0.1, "range_max": 30.0} | wrong
    with pytest.raises(LogError, match="no such scanner"):
        sweep_points(SimpleNamespace(**sizes, ranges=np.ones(3, np.float32)))
