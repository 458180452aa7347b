"""Tests the bag reader on bags written by BagWriter, on bags placed by hand, and on real ones."""

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2

from pipeline.core.compute import Compute
from pipeline.core.errors import LogError
from pipeline.core.frames import transformed, yaw
from pipeline.formats.bag import BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.readers.bag import Bag
from pipeline.readers.bag_poses import Tree, longest_increasing
from tests.readers import by_hand
from tests.readers.bags import BODY_T_LIDAR, KINDS, START_NS, STEP_NS, at, bag_path, cloud, drive
from tests.readers.damage import one_line

READER = Bag(ground_truth="/ground_truth", odometry="/odom")
HERE = (0, 0, 0, 0, 0, 0)
"""Extrinsics of a LiDAR in the origin of the body."""
BY_HAND = Bag(points="/cloud", ground_truth="/pose", body_T_lidar=HERE, max_gap_s=3)
"""Reads the bags of `by_hand`."""
OLD_TF_MD5 = "94810edda583a504dfda3829e70d7eec"
POINT = [[0, 0, 0]]
"""A cloud of one point."""


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_is_read(tmp_path: Path, kind: str) -> None:
    drive(bag_path(tmp_path, kind), kind)
    log = READER.open(tmp_path, "drive")
    assert log.stamps_ns.tolist() == [START_NS + STEP_NS // 2 + i * STEP_NS for i in range(4)]
    # Clouds come half-way between the poses at i and i + 1 metres.
    halfway_m = np.array([[i + 0.5, 0, 0] for i in range(4)])
    np.testing.assert_allclose(log.world_T_scan[:, :3, 3], halfway_m, atol=1e-6)
    np.testing.assert_allclose(log.odom_T_scan[:, :3, 3], np.add(halfway_m, (100, 0, 0)), atol=1e-6)
    # The LiDAR looks left from (0.5, 0, 1.5): its x is the body's y, its y the body's −x.
    for row in (3, 0, 2, 1):
        np.testing.assert_allclose(log.points(row), [[0.5, row, 1.5], [-1.5, 1, 4.5]], atol=1e-6)
    assert (log.notes, log.skipped) == ((), {})
    assert READER.sequences(tmp_path) == {"drive": []}


@pytest.mark.parametrize(
    ("make", "suffix", "big"),
    [
        (by_hand.ros1, "bag", ()),
        *((by_hand.mcap, "mcap", (big,)) for big in (False, True)),
        *((by_hand.db3, "db3", (big,)) for big in (False, True)),
    ],
)
def test_bags_laid_out_by_hand_are_read(
    tmp_path: Path, make: Callable[..., Path], suffix: str, big: tuple[bool, ...]
) -> None:
    make(tmp_path / f"drive.{suffix}", *big)
    log = replace(BY_HAND, lift_m=0.25).open(tmp_path, "drive")
    assert log.stamps_ns.tolist() == [10_500_000_000, 11_000_000_000]
    np.testing.assert_allclose(log.world_T_scan[:, :3, 3], [[2.5, 0, 0], [5, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(yaw(log.world_T_scan), np.pi / 2)
    points_m = np.concatenate([log.points(0), log.points(1)])
    np.testing.assert_allclose(points_m, [[1, 2, 3.25], [4, 5, 6.25]])
    assert np.isnan(log.odom_T_scan).all()


@pytest.mark.parametrize("fmt", rosbag1.Writer.CompressionFormat)
def test_a_compressed_ros1_bag_is_read(
    tmp_path: Path, fmt: rosbag1.Writer.CompressionFormat
) -> None:
    unused = rosbag1.Writer("unused.bag")
    unused.set_compression(fmt)
    with (
        rosbag1.Reader(drive(tmp_path / "plain.bag", "ros1")) as old,
        rosbag1.Writer(tmp_path / "small.bag") as new,
    ):
        new.compression_format = unused.compression_format
        new.compressor = unused.compressor
        copy_messages(old, new, "md5sum")
    assert_same(tmp_path)


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        *((plugin, rosbag2.CompressionMode.FILE) for plugin in rosbag2.StoragePlugin),
        *((plugin, rosbag2.CompressionMode.MESSAGE) for plugin in rosbag2.StoragePlugin),
        (rosbag2.StoragePlugin.MCAP, rosbag2.CompressionMode.STORAGE),
    ],
)
def test_a_compressed_ros2_bag_is_read(
    tmp_path: Path, mode: rosbag2.CompressionMode, plugin: rosbag2.StoragePlugin
) -> None:
    writer = rosbag2.Writer(tmp_path / "small", version=8, storage_plugin=plugin)
    writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with rosbag2.Reader(drive(tmp_path / "plain", "mcap")) as old, writer as new:
        copy_messages(old, new, "rihs01")
    assert_same(tmp_path)


def copy_messages(old: Any, new: Any, digest: str) -> None:
    """Copy all messages of a bag; `digest` is the name of a definition's digest in the writer."""
    new_connections = {}
    for old_connection in old.connections:
        new_connections[old_connection.id] = new.add_connection(
            old_connection.topic,
            old_connection.msgtype,
            msgdef=old_connection.msgdef.data,
            **{digest: old_connection.digest},
        )
    for connection, stamp, data in old.messages():
        new.write(new_connections[connection.id], stamp, data)


def assert_same(root: Path) -> None:
    """Check that the bags `small` and `plain` hold the same drive."""
    small = READER.open(root, "small")
    plain = READER.open(root, "plain")
    np.testing.assert_array_equal(small.stamps_ns, plain.stamps_ns)
    np.testing.assert_array_equal(small.world_T_scan, plain.world_T_scan)
    for row in range(len(small.stamps_ns)):
        np.testing.assert_array_equal(small.points(row), plain.points(row))


def test_bags_of_all_kinds_make_one_sequence_in_order_of_time(tmp_path: Path) -> None:
    # By name the last comes first; each holds the pose after its last cloud, as the next does
    # again.
    for kind, name, first in (("ros1", "c", 0), ("sqlite3", "b", 4), ("mcap", "a", 8)):
        drive(bag_path(tmp_path / "day", kind, name), kind, first=first)
    log = READER.open(tmp_path, "day")
    np.testing.assert_allclose(log.world_T_scan[:, 0, 3], np.arange(12) + 0.5, atol=1e-6)
    np.testing.assert_allclose(log.points(7)[0], [0.5, 7, 1.5], atol=1e-6)
    assert (
        "/ground_truth: 2 of 15 poses are left out, their stamps repeat or run backwards"
        in log.notes
    )
    assert READER.sequences(tmp_path) == {"day": []}


def test_reading_from_other_processes_and_threads_is_the_same(tmp_path: Path) -> None:
    drive(bag_path(tmp_path, "ros1"), "ros1", clouds=40)
    log = READER.open(tmp_path, "drive")
    alone = [log.points(row) for row in range(40)]

    def block(start: int, stop: int) -> list[np.ndarray]:
        return [log.points(row) for row in range(start, stop)]

    for scheduler in ("threads", "processes"):
        found = [points for part in Compute(scheduler, 2).rows(block, 40, 8) for points in part]
        np.testing.assert_array_equal(found, alone)


def written(root: Path, write: Callable[[BagWriter], None], poses: int = 5) -> Path:
    """A bag with poses every 100 ms on /ground_truth, 1 m apart, and whatever `write` adds."""
    with BagWriter(root / "drive.bag", "ros1") as bag:
        for i in range(poses):
            bag.odometry(START_NS + i * STEP_NS, "map", "base_link", at(i), "/ground_truth")
        write(bag)
    return root


def test_clouds_are_put_in_order_and_repeated_stamps_counted(tmp_path: Path) -> None:
    def write(bag: BagWriter) -> None:
        for x, step in ((1, 2), (2, 1), (3, 2), (4, 3)):
            cloud(bag, START_NS + step * STEP_NS, "lidar", [[x, 0, 0]])

    log = Bag(ground_truth="/ground_truth", body_T_lidar=HERE).open(
        written(tmp_path, write), "drive"
    )
    assert [log.points(row)[0, 0] for row in range(3)] == [2, 1, 4]
    assert log.skipped == {"stamp of an earlier one": 1}


def test_the_fewest_poses_are_left_out_when_stamps_run_backwards() -> None:
    # One stamp from the future costs one row, not all that follow; the jump back from 7 to 4 costs
    # two.
    assert longest_increasing(np.array([1, 2, 99, 3, 3, 4, 5])).tolist() == [0, 1, 4, 5, 6]
    assert longest_increasing(np.array([1, 6, 7, 4, 5, 8, 9, 10])).size == 6
    assert longest_increasing(np.array([], np.int64)).size == 0


def test_messages_without_stamps_are_placed_by_their_receipt(tmp_path: Path) -> None:
    # The data of hand-made messages with stamp 0, received at 10 s, 10.5 s, 11 s and 12 s.
    stamps = {**by_hand.CLOUDS, **by_hand.POSES}
    by_hand.db3(tmp_path / "drive.db3")
    with sqlite3.connect(tmp_path / "drive.db3") as base:
        for stamp, numbers in stamps.items():
            encode = by_hand.cdr_cloud if stamp in by_hand.CLOUDS else by_hand.cdr_pose
            data = encode(0, numbers)
            base.execute("UPDATE messages SET data = ? WHERE timestamp = ?", (data, stamp))
    base.close()
    log = BY_HAND.open(tmp_path, "drive")
    assert log.stamps_ns.tolist() == list(by_hand.CLOUDS)
    np.testing.assert_allclose(log.points(1), [[4, 5, 6]])
    assert log.notes == tuple(
        f"{topic}: no message is stamped; the times of receipt are used"
        for topic in ("/cloud", "/pose")
    )


def test_clouds_in_gaps_and_invalid_poses_are_counted(tmp_path: Path) -> None:
    def write(bag: BagWriter) -> None:
        bag.odometry(START_NS + 10 * STEP_NS, "map", "base_link", at(np.nan), "/ground_truth")
        bag.odometry(START_NS + 11 * STEP_NS, "map", "base_link", at(11), "/ground_truth")
        for step in (-1, 1, 6, 11, 12):
            cloud(bag, START_NS + step * STEP_NS, "lidar", POINT)

    log = Bag(ground_truth="/ground_truth", body_T_lidar=HERE).open(
        written(tmp_path, write), "drive"
    )
    np.testing.assert_allclose(log.world_T_scan[:, 0, 3], [1, 11])
    assert log.skipped == {"outside the poses' span": 2, "in a gap of the poses": 1}
    assert log.notes == ("/ground_truth: 1 of 7 poses hold no place or no rotation: gaps",)


def test_a_chain_of_transforms_gives_a_trajectory(tmp_path: Path) -> None:
    # map>odom moves 1 m aside within 400 ms, odom>base_link 1 m ahead each 100 ms, base_link is 1 m
    # below the IMU.
    def write(bag: BagWriter) -> None:
        up = np.eye(4)
        up[2, 3] = -1.0
        bag.static_transform(START_NS, "imu", "base_link", up)
        bag.static_transform(START_NS, "imu", "lidar", np.eye(4))
        for i in range(5):
            bag.transform(START_NS + i * STEP_NS, "odom", "imu", at(i))
            if i % 4 == 0:
                side = np.eye(4)
                side[1, 3] = i / 4
                bag.transform(START_NS + i * STEP_NS, "map", "odom", side)
        cloud(bag, START_NS + STEP_NS, "lidar", POINT)

    reader = Bag(ground_truth="tf:map>base_link", odometry="tf:odom>base_link")
    log = reader.open(written(tmp_path, write), "drive")
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1, 0.25, -1], atol=1e-12)
    np.testing.assert_allclose(log.odom_T_scan[0, :3, 3], [1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(log.points(0), [[0, 0, 1]])
    there = "imu>base_link, imu>lidar"
    with one_line(LogError, f"lead from world to base_link; those that it holds: {there}"):
        Bag(ground_truth="tf:world>base_link").open(tmp_path, "drive")
    with pytest.raises(LogError, match="tf:imu>lidar never changes"):
        Bag(ground_truth="tf:imu>lidar").open(tmp_path, "drive")


def test_transforms_of_old_bags_have_another_name(tmp_path: Path) -> None:
    # tf/tfMessage of ROS before Groovy, with its MD5 as its definition gives it.
    with BagWriter(tmp_path / "new.bag", "ros1") as bag:
        for i in range(5):
            bag.transform(START_NS + i * STEP_NS, "/odom", "/lidar", at(i))
        cloud(bag, START_NS + STEP_NS, "/lidar", POINT)
    with rosbag1.Reader(tmp_path / "new.bag") as new, rosbag1.Writer(tmp_path / "drive.bag") as old:
        for connection, stamp_ns, data in new.messages():
            kind = connection.msgtype.replace("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
            md5 = OLD_TF_MD5 if kind == "tf/msg/tfMessage" else connection.digest
            link = next((link for link in old.connections if link.topic == connection.topic), None)
            link = link or old.add_connection(
                connection.topic, kind, msgdef=connection.msgdef.data, md5sum=md5
            )
            old.write(link, stamp_ns, data)
    log = Bag(ground_truth="tf:odom>lidar").open(tmp_path, "drive")
    np.testing.assert_allclose(log.world_T_scan[:, 0, 3], [1])


def test_odometry_of_another_frame_is_moved_to_the_frame_of_the_true_poses(tmp_path: Path) -> None:
    # The wheels' frame is 2 m behind the body: the body is at 102 m when they are at 100.
    def write(bag: BagWriter) -> None:
        bag.static_transform(START_NS, "wheels", "base_link", at(2))
        for i in range(5):
            bag.odometry(START_NS + i * STEP_NS, "odom", "wheels", at(100 + i), "/odom")
        cloud(bag, START_NS + STEP_NS, "base_link", POINT)

    log = READER.open(written(tmp_path, write), "drive")
    np.testing.assert_allclose(log.odom_T_scan[0, :3, 3], [103, 0, 0])


def test_sweeps_are_laid_out_in_the_vehicle(tmp_path: Path) -> None:
    # Five beams from −90° to 90°, clockwise on a scanner mounted upside down; the 1st too near, the
    # 4th too far, the 5th none.
    def write(bag: BagWriter) -> None:
        ranges = np.array([0.05, 2.0, 3.0, 31.0, np.inf])
        bag.laser_scan(START_NS + STEP_NS, "laser", ranges, np.pi / 2, -np.pi / 4, 0.1, 30.0)

    reader = Bag(points="/scan", ground_truth="/ground_truth", body_T_lidar=[1, 0, 0.5, 0, 0, 90])
    log = reader.open(written(tmp_path, write), "drive")
    # 45° on the scanner is 135° on the vehicle, 0° is 90°.
    np.testing.assert_allclose(log.points(0), [[1 - 2**0.5, 2**0.5, 0.5], [1, 3, 0.5]], atol=1e-6)


def test_sweeps_without_a_place_are_kept_for_their_odometry_until_it_breaks(tmp_path: Path) -> None:
    # Ground truth at 0 … 0.4 s and 3 … 3.2 s, odometry at 0 … 1 s and 2 … 3.2 s, a sweep each 0.1
    # s.
    def write(bag: BagWriter) -> None:
        for step in [*range(11), *range(20, 33)]:
            bag.odometry(START_NS + step * STEP_NS, "odom", "base_link", at(step), "/odom")
        for step in (30, 31, 32):
            bag.odometry(START_NS + step * STEP_NS, "map", "base_link", at(step), "/ground_truth")
        for step in range(34):
            bag.laser_scan(START_NS + step * STEP_NS, "laser", np.ones(3), 0, 0.1, 0.1, 30)

    log = Bag("/scan", "/ground_truth", "/odom", HERE).open(written(tmp_path, write), "drive")
    steps = (log.stamps_ns - START_NS) // STEP_NS
    assert steps.tolist() == [*range(11), 30, 31, 32]
    assert np.isnan(log.world_T_scan[:, 0, 0]).tolist() == [False] * 5 + [True] * 6 + [False] * 3
    # The first row after the break says so, by a NaN.
    assert np.isnan(log.odom_T_scan[:, 0, 0]).tolist() == [False] * 11 + [True, False, False]
    assert log.notes == ("6 of 14 sweeps have no place (no pose on /ground_truth)",)
    assert log.skipped == {
        "in a gap of the poses": 9,
        "outside the poses' span": 1,
        "between a break of the odometry and the next place": 10,
    }


def test_the_error_on_a_bag_without_poses_lists_its_topics(real: Path) -> None:
    says = r"reader.ground_truth=/odom is not in it; expected Odometry, .*It holds /scan \(sensor_msgs/LaserScan, 360\)$"
    with one_line(LogError, says):
        Bag(points="/scan").open(real / "bags", "laserscan_rosbag1_v2.0")
    with one_line(LogError, r"reader.points=/points is not in it; expected PointCloud2, LaserScan"):
        Bag().open(real / "bags", "laserscan_rosbag1_v2.0")


def test_a_real_laser_scan_is_read_with_poses_beside_it(real: Path, tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    (tmp_path / "day" / "scan.bag").symlink_to(real / "bags" / "laserscan_rosbag1_v2.0.bag")
    with rosbag1.Reader(real / "bags" / "laserscan_rosbag1_v2.0.bag") as bag:
        start = bag.start_time
        end = bag.end_time
    assert round((end - start) * 1e-9, 1) == 35.8
    with BagWriter(tmp_path / "day" / "poses", "mcap") as writer:
        for i, stamp in enumerate(range(start - 10**9, end + 10**9, 10**8)):
            writer.odometry(stamp, "map", "base_link", at(0.1 * i))
    log = Bag(points="/scan", body_T_lidar=HERE).open(tmp_path, "day")
    assert len(log.stamps_ns) == 360
    points = log.points(100)
    assert len(points) > 100
    assert (points[:, 2] == 0).all()
    assert np.hypot(*points[:, :2].T).max() < 100


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "laserscan_rosbag1_bad_index",
            "bad_index.bag: cannot be read as a bag: sizes and contents do not fit",
        ),
        ("laserscan_rosbag_v1.2", "v1.2.bag: a ROS 1 bag of version 1.2; only 2.0 can be read"),
    ],
)
def test_real_broken_bags_raise_an_error_of_one_line(real: Path, name: str, says: str) -> None:
    with one_line(LogError, says):
        Bag(points="/scan").open(real / "bags", name)
    assert says in Bag(points="/scan").sequences(real / "bags")[name][0]


def test_the_extrinsics_are_in_the_bag_or_in_the_yaml(tmp_path: Path) -> None:
    written(tmp_path / "without", lambda bag: cloud(bag, START_NS, "lidar", POINT))
    says = r"no fixed transforms lead from base_link to lidar; give reader\.body_T_lidar"
    with one_line(LogError, says):
        Bag(ground_truth="/ground_truth").open(tmp_path / "without", "drive")
    drive(bag_path(tmp_path, "mcap"), "mcap")
    configured = Bag(ground_truth="/ground_truth", body_T_lidar=[0.5, 0, 1.5, 0, 0, 90]).open(
        tmp_path, "drive"
    )
    by_transforms = READER.open(tmp_path, "drive")
    np.testing.assert_allclose(configured.points(2), by_transforms.points(2), atol=1e-12)
    lies_m = transformed(BODY_T_LIDAR, np.array([[2, 0, 0], [1, 2, 3]], np.float32))
    np.testing.assert_allclose(configured.points(2), lies_m, atol=1e-5)


def test_a_missing_bag_or_topic_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("empty", "absent"):
        with pytest.raises(LogError, match=f"{name}: no bag there"):
            Bag().open(tmp_path, name)
    assert Bag().sequences(tmp_path) == {}
    drive(bag_path(tmp_path, "ros1"), "ros1")
    (missing,) = Bag(ground_truth="/gps").sequences(tmp_path)["drive"]
    assert missing.startswith(f"{tmp_path}/drive.bag: reader.ground_truth=/gps is not in it")


def test_broken_transforms_are_counted_in_the_tracks_notes(tmp_path: Path) -> None:
    path = tmp_path / "drive.bag"
    with BagWriter(path, "ros1") as bag:
        for i in range(4):
            bag.transform(START_NS + i * STEP_NS, "map", "base_link", at(i))
    file = BagFile(path)
    whole = file.decode
    messages = count()

    def first_is_broken(data: bytes, kind: str) -> Any:
        return whole(data[:9] if next(messages) == 0 else data, kind)

    file.decode = first_is_broken  # type: ignore[method-assign]
    assert Tree.read([file], moving=True).make_track("map", "base_link", 0.5).notes == (
        "tf:map>base_link: 1 broken messages of transforms are left out",
    )


@pytest.mark.parametrize(
    ("frame", "world", "says"),
    [
        ("other", "map", "/points comes in several frames, lidar, other; give reader.body_T_lidar"),
        ("lidar", "odom", "/ground_truth gives poses in several frames: map, odom"),
    ],
)
def test_a_topic_in_several_frames_is_refused(
    tmp_path: Path, frame: str, world: str, says: str
) -> None:
    def write(bag: BagWriter) -> None:
        cloud(bag, START_NS, "lidar", POINT)
        cloud(bag, START_NS + STEP_NS, frame, POINT)
        bag.odometry(START_NS + 5 * STEP_NS, world, "base_link", at(5), "/ground_truth")

    with one_line(LogError, says):
        Bag(ground_truth="/ground_truth").open(written(tmp_path, write), "drive")


def test_an_mcap_of_another_profile_is_refused(tmp_path: Path) -> None:
    """In the header of an MCAP, the profile's length and name follow 17 bytes of magic and
    length."""
    path = next(drive(tmp_path / "drive", "mcap").glob("*.mcap"))
    data = path.read_bytes()
    other = tmp_path / "other.mcap"
    other.write_bytes(data.replace(b"\x04\x00\x00\x00ros2", b"\x04\x00\x00\x00ros1", 1))
    says = r"an MCAP of profile 'ros1'; only those of ROS 2 can be read: give the ROS 1 \.bag"
    with pytest.raises(LogError, match=says):
        BagFile(other)
