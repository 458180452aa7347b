"""Tests the reader of a user's own folder: scans of three formats, TUM and KITTI poses, and what is
refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import rpy, transformed, yaw
from pipeline.formats import folder as files
from pipeline.readers.folder import Folder, read_kitti, read_scan, read_tum
from pipeline.readers.log import Log
from tests.readers.damage import one_line
from tests.readers.logs import folder_log

START = 1_326_030_975
POSE = "1 0 0 0 0 1 0 0 0 0 1 "
USUAL = Folder()


def cloud(*points: tuple[float, ...]) -> bytes:
    """A .bin of points x, y, z, each with an intensity of 0.5."""
    return np.array([(*point, 0.5) for point in points], "<f4").tobytes()


def scans(*stems: object) -> dict[str, bytes]:
    """Scan files of one point by their names."""
    return {f"scans/{stem}.bin": cloud((1, 1, 1)) for stem in stems}


def opened(root: Path, reader: Folder = USUAL, **files: Any) -> Log:
    """Open a sequence that is written with these files."""
    return reader.open(folder_log(root, **files), "drive")


# Scans


def test_a_bin_is_rows_of_floats_as_wide_as_declared(tmp_path: Path) -> None:
    path = tmp_path / "1.bin"
    path.write_bytes(np.arange(10, dtype="<f4").tobytes())
    np.testing.assert_array_equal(read_scan(path, np.eye(4), 20), [[0, 1, 2], [5, 6, 7]])
    with pytest.raises(
        LogError, match=r"40 bytes are no whole number of 16-byte points \(reader.point_bytes\)"
    ):
        read_scan(path, np.eye(4), 16)


def test_an_npy_is_read_byte_by_byte(tmp_path: Path) -> None:
    # Version 1.0, a header of 118 bytes so that the points start at byte 128; big-endian 16-bit
    # integers, by columns.
    head = "{'descr': '>i2', 'fortran_order': True, 'shape': (2, 4), }"
    data = b"\x93NUMPY\x01\x00" + bytes([118, 0]) + head.ljust(117).encode() + b"\n"
    path = tmp_path / "1.npy"
    path.write_bytes(data + bytes([0, 1, 0, 5, 0, 2, 0, 6, 0xFF, 0xFD, 0, 7, 0, 9, 0, 9]))
    np.testing.assert_array_equal(read_scan(path, np.eye(4), 16), [[1, 2, -3], [5, 6, 7]])


@pytest.mark.parametrize("kind", ["<f2", "<f4", ">f4", "<f8", "<i4", "u1"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_any_type_and_order_are_read(tmp_path: Path, kind: str, order: str) -> None:
    points = np.arange(20).reshape(5, 4).astype(kind, order=order)  # type: ignore[call-overload]
    np.save(tmp_path / "1.npy", points)
    found = read_scan(tmp_path / "1.npy", np.eye(4), 16)
    np.testing.assert_array_equal(found, points[:, :3].astype(float))


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ((4, 2000), r": its columns are its points; save `numpy.moveaxis\(array, 0, -1\)`"),
        ((3, 16, 64), ": its columns are its points"),
        ((64, 1024), "; a range image has no x, y, z"),
        ((20, 2), "; x, y and z are needed"),
    ],
)
def test_an_array_that_holds_no_points_along_its_last_axis_is_refused(
    tmp_path: Path, shape: tuple[int, ...], says: str
) -> None:
    np.save(tmp_path / "1.npy", np.ones(shape, np.float32))
    with pytest.raises(
        LogError, match=rf"1.npy: expected points .*found float32{re.escape(str(shape))}{says}"
    ):
        read_scan(tmp_path / "1.npy", np.eye(4))


def test_a_note_says_that_the_width_of_points_is_a_guess(tmp_path: Path) -> None:
    """500 points of 16 bytes in a cube filled evenly may as well be 400 of 20 bytes. A number that
    is set is no guess."""
    cube = np.random.default_rng(0).uniform(-20, 20, (500, 4)).astype("<f4").tobytes()
    root = folder_log(tmp_path, scans={f"scans/{START}.150.bin": cube})
    (note,) = Folder().open(root, "drive").notes
    says = "fits points of several sizes: 16 bytes are assumed; say reader.point_bytes"
    assert f"{START}.150.bin {says}" in note
    assert Folder(point_bytes=16).open(root, "drive").notes == ()


def test_a_file_as_large_as_a_map_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "LARGEST_BYTES", 31)
    (tmp_path / "1.bin").write_bytes(bytes(32))
    with pytest.raises(LogError, match="32 bytes are more than one scan has"):
        read_scan(tmp_path / "1.bin", np.eye(4), 16)


def test_points_that_no_lidar_sees_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "1.bin"
    path.write_bytes(cloud((1, 2, 3), (np.nan, 0, 0), (0, np.inf, 0), (0, 0, 3e38), (4, 5, 6)))
    np.testing.assert_array_equal(read_scan(path, np.eye(4), 16), [[1, 2, 3], [4, 5, 6]])


# Poses


def test_a_tum_file_may_have_commas_comments_and_unknown_rows(tmp_path: Path) -> None:
    # A quarter turn to the left is (0, 0, √½, √½). As a double, 1326030976.123456789 would be
    # …123456717. The last quaternion is half a per mille too long, and normalised.
    path = tmp_path / "poses.txt"
    path.write_text(
        f"# stamp x y z qx qy qz qw\n{START}.5 1 2 3 0 0 0.70710678 0.70710678\n\n"
        f"{START + 1}.123456789, 4, 5, 6, 0, 0, 0, 1 # end\n"
        f"{START + 2} nan nan nan nan nan nan nan\n{START + 3} 0 0 0 0 0 0 1.0005\n"
    )
    stamps_ns, poses = read_tum(path)
    assert (stamps_ns - START * 10**9).tolist() == [5 * 10**8, 1_123_456_789, 2 * 10**9, 3 * 10**9]
    np.testing.assert_allclose(poses[:2, :3, 3], [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(np.rad2deg(yaw(poses[:2])), [90, 0], atol=1e-6)
    assert np.isnan(poses[2]).all()
    np.testing.assert_allclose(poses[3], np.eye(4), atol=1e-12)


@pytest.mark.parametrize(
    ("poses", "times", "says"),
    [
        (f"{POSE}0\n", "0\n1\n", "2 times for 1 poses"),
        (f"{POSE}0\n2 0 0 0 0 1 0 0 0 0 1 0\n", "0\n1\n", "row 2 has no rotation"),
        (f"{POSE}0\n-1 0 0 0 0 1 0 0 0 0 1 0\n", "0\n1\n", "row 2 has no rotation"),  # a mirror
        (f"{POSE}1e9\n{POSE}0\n", "0\n1\n", "row 1 is not finite, or lies nowhere on Earth"),
        (f"{POSE}0\n{POSE}0\n", "1\n1\n", "row 2 is stamped"),
        ("1 2 3\n", "0\n", "expected 12 numbers a row"),
    ],
)
def test_wrong_kitti_poses_raise_an_error_of_one_line(
    tmp_path: Path, poses: str, times: str, says: str
) -> None:
    (tmp_path / "poses.txt").write_text(poses)
    (tmp_path / "times.txt").write_text(times)
    with one_line(LogError, says):
        read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt")


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (f"{POSE}0", "12 numbers a row are KITTI's: reader.poses_format: kitti"),
        (f"{START} {POSE}0", "13 numbers a row are a stamp and a matrix of 3 rows and 4 columns"),
        (f"{START}123456789 1 0 0 0 0 0 1", "its stamp is in ns"),
        (f"{START}123456 1 0 0 0 0 0 1", "its stamp is in us"),
        (f"{START}123 1 0 0 0 0 0 1", "its stamp is in ms"),
    ],
)
def test_the_error_on_poses_of_another_layout_names_the_layout(
    tmp_path: Path, row: str, says: str
) -> None:
    (tmp_path / "poses.txt").write_text(f"{row}\n")
    with one_line(LogError, f"expected stamp x y z qx qy qz qw, in s and m; {says}"):
        read_tum(tmp_path / "poses.txt")


def test_the_error_on_tum_poses_instead_of_kitti_poses_names_the_setting(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text(f"{START} 1 0 0 0 0 0 1\n")
    with one_line(LogError, "8 numbers a row are a TUM trajectory's: reader.poses_format: tum"):
        read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt")


# Logs


def test_a_scan_between_two_poses_lies_halfway(tmp_path: Path) -> None:
    # 10 m/s forward, poses every 0.1 s: at 0.15 s, 1.5 m. The lidar's point is 2 m ahead, 1 m left,
    # 3 m up.
    log = opened(tmp_path)
    assert log.stamps_ns.tolist() == [START * 10**9 + 150_000_000]
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1.5, 0, 0])
    np.testing.assert_allclose(log.points(0), [[2, 1, 3]])
    assert np.isnan(log.odom_T_scan).all()
    assert not log.skipped


@pytest.mark.parametrize(
    ("stamps", "stem"),
    [
        ("s", f"{START}.150"),
        ("us", f"{START}150000"),
        ("ns", f"{START}150000000"),
        ("ns", f"00{START}150000000"),
    ],
)
def test_names_are_stamps_in_the_declared_unit(tmp_path: Path, stamps: str, stem: str) -> None:
    log = opened(tmp_path, Folder(stamps=stamps), scans=scans(stem))
    assert log.stamps_ns.tolist() == [START * 10**9 + 150_000_000]


def test_the_error_on_names_in_another_unit_names_the_unit(tmp_path: Path) -> None:
    """Decimals of a second fit no double: by their digits these are nanoseconds, beyond any stamp
    in seconds."""
    says = f"{START}123456789.bin is none: is it in ns\\? Then say reader.stamps=ns"
    with pytest.raises(LogError, match=says):
        opened(tmp_path, scans=scans(f"{START}123456789"))


@pytest.mark.parametrize("stamps", ["us", "ns"])
def test_the_error_on_a_wrong_unit_gives_both_time_spans(tmp_path: Path, stamps: str) -> None:
    says = f"none of its 1 scans has a pose: .*the poses 1326030975.000 .*reader.stamps={stamps}"
    with pytest.raises(LogError, match=says):
        opened(tmp_path, Folder(stamps=stamps), scans=scans(START))


def key_frames(every_s: float, off_us: int) -> dict[str, str | dict[str, bytes]]:
    """Arguments of `folder_log`: five poses 5 m apart, and a scan `off_us` µs after each."""
    times = [START + every_s * i for i in range(5)]
    poses = "".join(f"{time:.6f} {5 * i} 0 0 0 0 0 1\n" for i, time in enumerate(times))
    return {"poses": poses, "scans": scans(*(f"{time + 1e-6 * off_us:.6f}" for time in times))}


def test_key_frames_have_their_own_poses_however_sparse_and_rounded(tmp_path: Path) -> None:
    log = opened(tmp_path, **key_frames(2.0, off_us=1))
    np.testing.assert_array_equal(log.world_T_scan[:, 0, 3], [0, 5, 10, 15, 20])


def test_scans_between_sparse_poses_are_refused_for_the_gap_not_the_unit(tmp_path: Path) -> None:
    with pytest.raises(LogError) as refused:
        opened(tmp_path, **key_frames(2.0, off_us=500_000))
    line = str(refused.value)
    reasons = "4 in a gap of the poses, 1 outside the poses' span; they span"
    assert f"none of its 5 scans has a pose: {reasons}" in line
    assert "poses are usually 2 s apart, more than reader.max_gap_s=0.5" in line
    assert "unit" not in line


def test_the_first_and_the_last_scan_have_the_poses_of_their_own_stamps(tmp_path: Path) -> None:
    # Six decimals in both; read as doubles, or as doubles on one side only, an end could fall out
    # of the poses' span.
    names = [f"{START}.123457", f"{START}.999999"]
    poses = "".join(f"{name} {x} 0 0 0 0 0 1\n" for x, name in enumerate(names))
    log = opened(tmp_path, poses=poses, scans=scans(*names))
    np.testing.assert_array_equal(log.world_T_scan[:, 0, 3], [0, 1])


def test_the_lidars_place_and_the_bodys_height_move_the_points(tmp_path: Path) -> None:
    # The lidar looks left (yaw 90°) from (1, 0, 0.5): its (2, 1, 3) is 1 left of −2… x = 1 − 1, y =
    # 2, z = 3.5; the body's origin is 0.3 m over the ground.
    log = opened(tmp_path, Folder(body_T_lidar=[1, 0, 0.5, 0, 0, 90], lift_m=0.3))
    np.testing.assert_allclose(log.points(0), [[0, 2, 3.8]], atol=1e-12)
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1.5, 0, 0], atol=1e-12)


def test_a_point_lies_in_the_world_where_the_raw_poses_put_it_plus_the_lift(tmp_path: Path) -> None:
    # Rolled by 90° to the right: up becomes right… whatever the pose, world_T_scan · points is
    # world_T_body · p, lifted.
    pose = "1 2 3 0.70710678 0 0 0.70710678"  # roll 90°: y → z, z → −y
    poses = f"{START} {pose}\n{START + 1} {pose}\n"
    scan = {f"scans/{START}.bin": cloud((2, 1, 3))}
    log = opened(tmp_path, Folder(lift_m=0.3), poses=poses, scans=scan)
    lies_m = transformed(log.world_T_scan[0], log.points(0))
    np.testing.assert_allclose(lies_m, [[1 + 2, 2 - 3, 3 + 1 + 0.3]], atol=1e-6)


def test_scans_of_all_formats_may_lie_in_one_folder(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[4.0, 5, 6]]))
    pcd = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n7 8 9\n"
    files = {
        f"scans/{START}.10.bin": cloud((1, 2, 3)),
        f"scans/{START}.20.npy": (tmp_path / "a.npy").read_bytes(),
        f"scans/{START}.30.pcd": pcd,
        f"scans/{START}.40.txt": b"no scan",
    }
    log = opened(tmp_path, scans=files)
    points_m = np.concatenate([log.points(row) for row in range(3)])
    np.testing.assert_array_equal(points_m, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    log = Folder(scans="scans/*.pcd").open(tmp_path, "drive")
    np.testing.assert_array_equal(log.points(0), [[7, 8, 9]])
    assert len(log.stamps_ns) == 1


def test_scans_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    named = (f"{START}.5", f"{START}.50", START + 60)
    unnamed = ("first", f"-{START}", f"{START}.1.2", 10**12)
    cut = {f"scans/{START}.6.bin": b"", f"scans/{START}.7.bin": cloud((1, 1, 1))[:-1]}
    log = opened(tmp_path, scans=scans(*named, *unnamed) | cut)
    assert len(log.stamps_ns) == 1
    assert log.skipped == {
        "a second file of one stamp": 1,
        "empty file": 1,
        "truncated record": 1,
        "outside the poses' span": 1,
        "file name is no stamp": 4,
    }


def test_a_scan_in_a_gap_of_the_poses_is_skipped(tmp_path: Path) -> None:
    poses = "".join(f"{START + second} {second} 0 0 0 0 0 1\n" for second in (0, 1, 5, 6))
    log = opened(tmp_path, Folder(max_gap_s=2.0), poses=poses, scans=scans(START + 1, START + 3))
    np.testing.assert_array_equal(log.world_T_scan[:, 0, 3], [1])
    assert log.skipped == {"in a gap of the poses": 1}


def test_odometry_is_given_at_the_scans(tmp_path: Path) -> None:
    odometry = "".join(f"{START}.{tenth} {1.2 * tenth:.1f} 0 0 0 0 0 1\n" for tenth in range(4))
    root = folder_log(tmp_path)
    (root / "drive" / "odometry.txt").write_text(odometry)
    log = Folder(odometry="odometry.txt").open(root, "drive")
    np.testing.assert_allclose(log.odom_T_scan[0, :3, 3], [1.8, 0, 0])


def test_kitti_poses_belong_to_scans_by_number(tmp_path: Path) -> None:
    poses = "".join(f"1 0 0 {2 * i} 0 1 0 0 0 0 1 0\n" for i in range(4))
    names = ("000000", "3", "000004", "12")
    files = {f"scans/{name}.bin": cloud((int(name), 0, 0)) for name in names} | scans("1.5")
    times = "0.0\n0.1\n0.2\n0.3\n"
    log = opened(tmp_path, Folder(poses_format="kitti"), poses=poses, scans=files, times=times)
    assert log.stamps_ns.tolist() == [0, 300_000_000]
    np.testing.assert_array_equal(log.world_T_scan[:, 0, 3], [0, 6])
    np.testing.assert_array_equal(log.points(1), [[3, 0, 0]])
    assert log.skipped == {"file name is no row of the poses": 3}


def test_poses_of_a_camera_are_turned_upright(tmp_path: Path) -> None:
    # 5 m along the camera's z (forward), 3 m along its x (right), −4 m along its y (up); turned to
    # the right: z becomes x.
    reader = Folder(poses_format="kitti", poses_frame="camera")
    poses = f"{POSE}0\n0 0 1 3 0 1 0 -4 -1 0 0 5\n"
    log = opened(tmp_path, reader, poses=poses, scans=scans(1), times="0\n1\n")
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [5, -3, 4], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(rpy(log.world_T_scan)), [[0, 0, -90]], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"poses": None}, "poses.txt: no such file"),
        (
            {"scans": {}},
            r"holds no readable scan in scans \(named by stamps in s; .bin, .npy or .pcd\)",
        ),
        ({"scans": {"scans/one.bin": bytes(16)}}, "holds no readable scan"),
    ],
)
def test_a_folder_that_lacks_something_is_refused(
    tmp_path: Path, change: dict[str, object], says: str
) -> None:
    with one_line(LogError, says):
        opened(tmp_path, **change)
    with one_line(LogError, "other: no such folder of a sequence"):
        Folder().open(tmp_path, "other")


def test_a_damaged_scan_raises_an_error_only_when_it_is_read(tmp_path: Path) -> None:
    log = opened(tmp_path, scans={f"scans/{START}.1.pcd": b"no cloud"})
    with pytest.raises(LogError, match="no PCD file"):
        log.points(0)


def test_sequences_are_listed_with_what_they_lack(tmp_path: Path) -> None:
    folder_log(tmp_path)
    (tmp_path / "second" / "scans").mkdir(parents=True)
    (tmp_path / "second" / "scans" / "1.pcd").touch()
    (tmp_path / "else").mkdir()
    assert Folder().sequences(tmp_path) == {"drive": [], "second": ["poses.txt"]}
    reader = Folder(poses_format="kitti", odometry="odometry.txt")
    assert reader.sequences(tmp_path)["drive"] == ["times.txt", "odometry.txt"]
    assert Folder().sequences(tmp_path / "nowhere") == {}


def test_settings_may_come_from_hydra(tmp_path: Path) -> None:
    from omegaconf import OmegaConf

    numbers = OmegaConf.create({"at": [0, 0, 1, 0, 0, 0]}).at
    log = opened(tmp_path, Folder(body_T_lidar=numbers))
    np.testing.assert_allclose(log.points(0), [[2, 1, 4]])
