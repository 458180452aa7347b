"""Tests the KITTI reader on files made by hand, and on sixteen real scans."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import transformed, yaw
from pipeline.readers.kitti import Kitti, read_poses, read_velodyne
from tests.readers.damage import one_line
from tests.readers.logs import TR, kitti_log

POSE = "1 0 0 0 0 1 0 0 0 0 1 "


def test_poses_may_lie_beside_the_scans_as_semantickittis_do(tmp_path: Path) -> None:
    root = kitti_log(tmp_path)
    (root / "poses/07.txt").rename(root / "sequences/07/poses.txt")
    assert Kitti().sequences(root) == {"07": []}
    assert Kitti().open(root, "07").world_T_scan[:, 0, 3].tolist() == [0, 2, 4, 6, 8, 10]


def test_a_scan_stands_on_the_road(tmp_path: Path) -> None:
    # The camera moves 2 m along its z a frame, which is forward; the lidar's point 1.73 m below it
    # lies on the ground.
    log = Kitti().open(kitti_log(tmp_path), "07")
    driven_m = [[2 * i, 0, 0] for i in range(6)]
    np.testing.assert_allclose(log.world_T_scan[:, :3, 3], driven_m, atol=1e-12)
    np.testing.assert_allclose(log.points(3), [[3, 1, 0]], atol=1e-6)
    assert log.stamps_ns.tolist() == [i * 100_000_000 for i in range(6)]
    assert np.isnan(log.odom_T_scan).all()
    assert log.notes == ()


@pytest.mark.parametrize(
    ("calib", "turned", "place"),
    [
        # The camera's forward axis z becomes its old right, x; 3 m right of the start is y = −3, 4
        # m up (camera y −4) is z = 4.
        (TR, "0 0 1 3 0 1 0 -4 -1 0 0 5", [5, -3, 4]),
        # The lidar sits 1 m ahead of the camera (camera z = lidar x + 1). After a right turn on the
        # spot the lidar, first at forward 1, is at right 1: from its first place 1 m back and 1 m
        # right.
        ("Tr: 0 -1 0 0 0 0 -1 0 1 0 0 1", "0 0 1 0 0 1 0 0 -1 0 0 0", [-1, -1, 0]),
    ],
    ids=["the camera's axes", "the lever arm"],
)
def test_turning_the_camera_to_the_right_turns_the_vehicle_clockwise(
    tmp_path: Path, calib: str, turned: str, place: list[float]
) -> None:
    kitti_log(tmp_path, calib=calib, poses=f"{POSE}0\n{turned}\n")
    poses = read_poses(tmp_path / "poses" / "07.txt", tmp_path / "sequences" / "07" / "calib.txt")
    np.testing.assert_allclose(poses[1, :3, 3], place, atol=1e-12)
    assert np.rad2deg(yaw(poses))[1] == pytest.approx(-90)


def test_points_that_are_no_numbers_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "000000.bin"
    rows = [[1, 2, 3, np.nan], [np.nan, 0, 0, 0], [0, np.inf, 0, 0], [4, 5, 6, 0]]
    path.write_bytes(np.array(rows, "<f4").tobytes())
    np.testing.assert_array_equal(read_velodyne(path), [[1, 2, 3], [4, 5, 6]])


def test_only_the_scans_on_disk_are_read(tmp_path: Path) -> None:
    whole = dict.fromkeys(("000001", "000004", "000006", "12", "scan01"), bytes(16))
    scans = whole | {"000002": b"", "000003": bytes(9)}
    log = Kitti().open(kitti_log(tmp_path, scans=scans), "07")
    np.testing.assert_allclose(log.world_T_scan[:, 0, 3], [2, 8])
    assert log.skipped == {
        "empty file": 1,
        "truncated record": 1,
        "file name is no scan number": 2,
        "outside the poses' span": 1,
    }
    assert log.notes == ("4 of 6 scans are not on disk",)


@pytest.mark.parametrize("split", [0.0, 0.3, 0.5, 0.9])
def test_each_scan_of_a_log_is_in_one_of_its_two_parts(tmp_path: Path, split: float) -> None:
    root = kitti_log(tmp_path)
    reader = Kitti(split=split)
    first, second, whole = (reader.open(root, name) for name in ("07-a", "07-b", "07"))
    assert first.stamps_ns.tolist() + second.stamps_ns.tolist() == whole.stamps_ns.tolist()
    poses = np.concatenate([first.world_T_scan, second.world_T_scan])
    np.testing.assert_array_equal(poses, whole.world_T_scan)
    np.testing.assert_array_equal(second.points(0), whole.points(len(first.stamps_ns)))
    # 10 m of path: part a ends at `split` of it, scans lie every 2 m from 0.
    assert len(first.stamps_ns) == int(10 * split / 2) + 1


@pytest.mark.parametrize(
    ("sequence", "kind"),
    [("07-c", ConfigError), ("07-a-b", ConfigError), ("07-A", ConfigError), ("08", LogError)],
)
def test_a_part_or_a_log_that_does_not_exist_is_refused(
    tmp_path: Path, sequence: str, kind: type
) -> None:
    with one_line(kind, sequence):
        Kitti().open(kitti_log(tmp_path), sequence)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"calib": None}, "calib.txt"),
        ({"calib": "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"}, "'Tr:' with 12 numbers"),
        ({"calib": "Tr: " + "x " * 12}, "'Tr:' with 12 numbers"),
        ({"calib": "Tr: " + "nan " * 12}, "'Tr:' with 12 numbers"),
        # no rotation: the poses would be NaN
        ({"calib": "Tr: 1e308 -1 0 0 0 0 -1 0 1 0 0 0\n"}, "calib.txt"),
        ({"poses": None}, "07.txt"),
        ({"poses": "1 0 0 0\n" * 6}, "12 numbers"),
        ({"poses": f"{POSE}0\n" * 3 + f"{POSE}nan\n" + f"{POSE}0\n" * 2}, "row 4 is not finite"),
        ({"poses": f"{POSE}0\n" * 5}, "6 times for 5 poses"),
        ({"times": None}, "times.txt"),
        ({"times": "0\n1\n2\n1.5\n3\n4\n"}, "row 4 is stamped"),
        (
            {"times": "0\n1e-11\n2\n3\n4\n5\n"},
            "row 2 is stamped 1e-11 s, after 0; stamps must increase",
        ),  # 0 ns both
        ({"times": "0\n1\nnan\n3\n4\n5\n"}, "row 3 is stamped"),
        ({"times": "0 1\n" * 6}, "1 numbers"),
        ({"scans": {}}, "no readable scan"),
        ({"scans": {"000009": bytes(16)}}, "no readable scan"),
    ],
)
def test_a_broken_log_raises_an_error_of_one_line(
    tmp_path: Path, change: dict[str, object], says: str
) -> None:
    with one_line(LogError, says):
        Kitti().open(kitti_log(tmp_path, **change), "07")


def test_sequences_are_listed_with_what_they_lack(tmp_path: Path) -> None:
    kitti_log(tmp_path, calib=None)
    (tmp_path / "sequences" / "09" / "velodyne").mkdir(parents=True)
    lacks = {
        "07": ["sequences/07/calib.txt"],
        "09": ["poses/09.txt", "sequences/09/calib.txt", "sequences/09/times.txt"],
    }
    assert Kitti().sequences(tmp_path) == lacks


def test_a_sequence_may_have_a_root_of_its_own(tmp_path: Path) -> None:
    for name in ("07-a", "07-b"):
        kitti_log(tmp_path / name)
    reader = Kitti(root_per_sequence=True)
    assert reader.sequences(tmp_path) == {"07-a": [], "07-b": []}
    first, second = (reader.open(tmp_path, name) for name in ("07-a", "07-b"))
    assert len(first.stamps_ns) + len(second.stamps_ns) == 6
    whole = Kitti().open(tmp_path / "07-b", "07")
    np.testing.assert_array_equal(second.points(0), whole.points(len(first.stamps_ns)))


def test_real_scans_lie_on_each_other_only_with_their_poses(real: Path) -> None:
    # Median distance of the points of scan j, more than 0.73 m above the road (z > −1 m for the
    # lidar), to scan 0's: about 0.07, 0.17, 0.27, 0.34 m with the pose; two to three times that
    # without.
    log = Kitti().open(real / "kitti", "00")
    assert len(log.stamps_ns) == 16
    assert log.notes == ("4525 of 4541 scans are not on disk",)

    def high(row: int) -> np.ndarray:
        points = log.points(row)
        return points[points[:, 2] > 0.73]

    tree = KDTree(high(0))
    for row, aligned_m in ((1, 0.07), (5, 0.17), (10, 0.27), (15, 0.34)):
        points = high(row)[::4]
        posed = transformed(np.linalg.inv(log.world_T_scan[0]) @ log.world_T_scan[row], points)
        aligned, unaligned = (float(np.median(tree.query(cloud)[0])) for cloud in (posed, points))
        assert aligned == pytest.approx(aligned_m, rel=0.25)
        assert aligned < 0.5 * unaligned


def test_a_real_vehicle_moves_forward_on_the_ground_in_two_parts(real: Path) -> None:
    # The sixteen scans span about 13 m, all ahead of the first; the road falls and rises by less
    # than a tenth of that.
    first, second, whole = (Kitti().open(real / "kitti", name) for name in ("00-a", "00-b", "00"))
    xyz = whole.world_T_scan[:, :3, 3]
    assert (np.diff(xyz[:, 0]) > 0.5).all()
    assert np.abs(xyz[:, 1:]).max() < 0.1 * xyz[-1, 0]
    assert first.stamps_ns.tolist() + second.stamps_ns.tolist() == whole.stamps_ns.tolist()
    assert min(len(first.stamps_ns), len(second.stamps_ns)) >= 7
