"""Tests what `yearloc inspect` says of raw files and folders: NCLT, KITTI, CARMEN, a user's own."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import flip_ned, pose, transformed
from pipeline.formats import nclt
from pipeline.inspection.report import inspect
from tests.inspection.scanner import assert_says, scan
from tests.readers.damage import one_line
from tests.readers.logs import carmen_log, key_frames

START_US = 1_326_652_795_000_000


def nclt_bytes(points: np.ndarray, beams: int = 32) -> bytes:
    """A velodyne_sync file of points (n, 3), whose lasers take turns."""
    laser = np.arange(len(points)) % beams
    return nclt.encode(
        points.astype(np.float32), np.full(len(points), 80, np.uint8), laser.astype(np.uint8)
    )


def nclt_sequence(root: Path, scans: int = 6) -> Path:
    """Write a sequence of NCLT: five scans a second, and ten true poses a second along x at 10
    m/s."""
    folder = root / "2012-01-15"
    (folder / "velodyne_sync").mkdir(parents=True)
    data = nclt_bytes(scan(32))
    for i in range(scans):
        (folder / "velodyne_sync" / f"{START_US + 200_000 * i}.bin").write_bytes(data)
    stamps = START_US + 100_000 * np.arange(2 * scans)
    rows = np.zeros((len(stamps), 6))
    rows[:, 0] = np.arange(len(stamps))
    nclt.write_pose_rows(folder / "groundtruth_2012-01-15.csv", stamps, rows)
    return folder


def kitti_file(path: Path, points: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.column_stack([points, np.full(len(points), 0.5)]).astype("<f4").tofile(path)
    return path


def test_the_format_of_a_scan_is_known_by_its_folders_name(tmp_path: Path) -> None:
    path = kitti_file(tmp_path / "velodyne" / "000000.bin", scan(64, ground_m=-1.73))
    found = inspect(path)
    assert "KITTI scan" in found.headline
    assert found.warnings == ()
    stray = kitti_file(tmp_path / "stray.bin", scan(64, ground_m=-1.73))
    assert_says(inspect(stray), "records of 16 bytes (as KITTI's)", "point_bytes: 16")
    assert "KITTI scan" in inspect(stray, "kitti").headline
    assert any("Then add --format kitti" in warning for warning in inspect(stray, "nclt").warnings)
    with pytest.raises(ConfigError, match="--format pcd"):
        inspect(stray, "pcd")


def test_a_sequence_is_opened_as_its_reader_opens_it(tmp_path: Path) -> None:
    folder = nclt_sequence(tmp_path)
    found = inspect(folder)
    assert_says(found, "6 with a true pose", "10 m, step median 2 m")  # 5 steps of 2 m
    assert found.warnings == ("no odometry_mu_100hz.csv",)
    assert "can be read" in inspect(tmp_path).text()
    (folder / "groundtruth_2012-01-15.csv").unlink()
    assert any("the reader refuses the sequence" in warning for warning in inspect(folder).warnings)


def test_a_folder_of_scans_counts_what_is_cut_short(tmp_path: Path) -> None:
    scans = nclt_sequence(tmp_path) / "velodyne_sync"
    (scans / f"{START_US + 1}.bin").write_bytes(b"1234567")
    found = inspect(scans)
    assert "rate           5 a second" in found.text()
    assert found.warnings == ("1 scans are skipped: truncated record",)


def test_poses_are_described_with_gaps_and_nans(tmp_path: Path) -> None:
    path = tmp_path / "groundtruth_2012-01-15.csv"
    rows = np.zeros((20, 6))
    rows[:, 0] = np.arange(20)
    rows[:3] = np.nan
    stamps = START_US + 100_000 * np.arange(20)
    stamps[10:] += 2_000_000
    nclt.write_pose_rows(path, stamps, rows)
    found = inspect(path)
    assert_says(found, "20, of which 3 hold a NaN", "16 m, median step 1 m")  # rows 3 … 19
    assert found.warnings[0].startswith("1 gaps over 0.5 s, the longest 2.1 s")


def test_the_covariances_of_the_odometry_are_not_described(tmp_path: Path) -> None:
    path = tmp_path / "odometry_cov.csv"
    path.write_text(", ".join(["1", *["0"] * 21]) + "\n")
    with one_line(LogError, "covariances, which the reader uses but inspect does not describe"):
        inspect(path)


def test_packets_are_counted_and_looked_at_in_the_bodys_frame(tmp_path: Path) -> None:
    numbers = np.array([nclt.BODY_T_VELODYNE_XYZRPH])
    body_T_velodyne = flip_ned(pose(numbers[:, :3], np.radians(numbers[:, 3:])))[0]
    hits = nclt_bytes(transformed(np.linalg.inv(body_T_velodyne), scan(64).astype(np.float32)))
    size = len(hits) // 8 // 4 * 8
    path = tmp_path / "velodyne_hits.bin"
    header = struct.pack("<4H", *[44444] * 4)
    packets = [
        header + struct.pack("<IQI", size // 8, START_US + 100 * i, 0) + hits[i % 4 * size :][:size]
        for i in range(8)
    ]
    path.write_bytes(b"".join(packets))
    found = inspect(path)
    assert f"8, with {8 * size // 8:,} hits" in found.text()
    assert "ground   at z = +0.0" in found.text() or "ground   at z = −0.0" in found.text()
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(LogError, match=f"no whole packet at byte {7 * (24 + size)}"):
        inspect(path)


def test_arrays_of_points_are_looked_at(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.column_stack([scan(64) / 50, np.ones(len(scan(64)))]))
    assert inspect(tmp_path / "a.npy").warnings[0].startswith("normalised cloud")
    np.save(tmp_path / "b.npy", np.ones((5, 2)))
    (tmp_path / "c.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:500])
    for name, says in (("b.npy", "expected points"), ("c.npy", "the file is damaged")):
        with pytest.raises(LogError, match=says):
            inspect(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("velodyne/000000.bin", b""),
        ("velodyne/000000.bin", b"123"),
        ("velodyne_sync/1326652795280148.bin", b"123"),
        ("groundtruth_2012-01-15.csv", b""),
        ("groundtruth_2012-01-15.csv", b"1,2,3\n"),
        ("odometry_mu_100hz.csv", b"\xff\xfe"),
        ("00.txt", b"1 2 3\n"),
        ("times.txt", b"noon\n"),
        ("times.txt", b"0.0\n0.1\n1e999\n"),
        ("calib.txt", b"P0: 1\n"),
        ("calib.txt", b"\xff\xfe:"),
        ("velodyne_hits.bin", b""),
    ],
)
def test_the_error_on_a_broken_raw_file_is_one_line_that_names_it(
    tmp_path: Path, name: str, data: bytes
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with one_line(LogError, path.name):
        inspect(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("kitti/sequences/00/velodyne/000003.bin", "124,167"),
        ("kitti/sequences/00/velodyne", "16, 31.4 MB"),
        ("kitti/sequences/00/times.txt", "4,541"),
        ("kitti/sequences/00/calib.txt", "Tr"),
        ("kitti/poses/00.txt", "3.72 km"),  # the odometry benchmark's own length of log 00
        ("nclt/2012-01-15/velodyne_sync/1326652795280148.bin", "23,546"),
    ],
)
def test_real_files_are_described_without_warnings(real: Path, name: str, words: str) -> None:
    found = inspect(real / name)
    assert words in found.text()
    assert found.warnings == ()


def test_a_tum_trajectory_is_described_with_path_and_gaps(tmp_path: Path) -> None:
    rows = [f"{100 + i / 10}, {3 * i} 0 {4 * i} 0 0 0 1" for i in range(5)]  # 5 m a row
    (tmp_path / "poses.txt").write_text(
        "# stamp x y z qx qy qz qw\n" + "\n".join([*rows, "101 nan 0 0 0 0 0 1"]) + "\n"
    )
    found = inspect(tmp_path / "poses.txt")
    assert_says(found, "TUM trajectory", "6, of which 1 hold a NaN", "20 m, median step 5 m")
    assert_says(found, "x 0.0 … 12.0 m, y 0.0 … 0.0 m, z 0.0 … 16.0 m")
    for text, kind, says in (
        ("100 0 0 0 0 0 0 2\n", LogError, "quaternion"),
        ("hello\n", ConfigError, "no kind of file"),
    ):
        (tmp_path / "poses.txt").write_text(text)
        with pytest.raises(kind, match=says):
            inspect(tmp_path / "poses.txt")


HEAD = (
    "VERSION 0.7\nFIELDS x y z normal\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 3\nWIDTH "
    "{n}\nHEIGHT 1\nPOINTS {n}\nDATA binary\n"
)


def test_a_pcd_is_described_with_its_fields_and_points(tmp_path: Path) -> None:
    rows = np.zeros((2000, 6), "<f4")
    rows[:, :2] = np.random.default_rng(0).uniform(-20, 20, (2000, 2))
    rows[5, 2] = np.nan
    path = tmp_path / "cloud.pcd"
    path.write_bytes(HEAD.format(n=2000).encode() + rows.tobytes())
    found = inspect(path)
    assert_says(found, "cloud.pcd — PCD cloud", "DATA binary")
    assert_says(found, "x f4, y f4, z f4, normal×3 f4", "1,999, and 1 that are not finite")
    path.write_bytes(HEAD.format(n=1).encode() + np.full(6, np.nan, "<f4").tobytes())
    with one_line(LogError, "none of its 1 points has finite x, y and z"):
        inspect(path)


def test_a_carmen_log_and_key_frames_are_described_as_their_readers_open_them(
    tmp_path: Path,
) -> None:
    log = inspect(carmen_log(tmp_path / "logs") / "drive.log")
    assert_says(log, "CARMEN log", "sweeps    6, 6 with a true pose")
    assert_says(log, "odometry  at 83.3 % of the sweeps")
    assert any("6 of 18 ranges reached the laser's limit" in warning for warning in log.warnings)
    assert_says(inspect(tmp_path / "logs"), "CARMEN root, sequences: 1", "drive  can be read")
    run = key_frames(tmp_path / "runs") / "run"
    found = inspect(run)
    assert_says(
        found, "key frames sequence run", "scans     4, 4 with a true pose", "path      3 m"
    )
    assert_says(inspect(tmp_path / "runs"), "key frames root, sequences: 1", "run  can be read")


# Another robot's


def own_sequence(root: Path, lies_m: Callable[[int], float]) -> Path:
    """Write a user's sequence of twenty scans of a yard, 10 m apart along x, with TUM poses.

    `lies_m` returns how far the points of a scan are moved along x.
    """
    points_m = scan(64, ground_m=0.0)
    rows = []
    for i in range(20):
        moved_m = points_m + np.array([lies_m(i), 0, 0])
        kitti_file(root / f"drive/scans/{100 + i}.000.bin", moved_m)
        rows.append(f"{100 + i} {10.0 * i} 0 0 0 0 0 1\n")
    (root / "drive/poses.txt").write_text("".join(rows))
    return root / "drive"


def test_scans_beside_poses_are_opened_by_the_reader_of_folders(tmp_path: Path) -> None:
    found = inspect(own_sequence(tmp_path, lambda i: 0.0))
    assert_says(found, "another robot's sequence drive", "scans     20, 20 with a true pose")
    assert_says(found, "190 m, step median 10 m")
    assert found.warnings == ()
    assert "can be read" in inspect(tmp_path).text()
    assert "scans of another robot" in inspect(tmp_path / "drive/scans").headline


def test_a_warning_says_that_clouds_are_in_the_world_already(tmp_path: Path) -> None:
    found = inspect(own_sequence(tmp_path, lambda i: 10.0 * i))
    assert any(warning.startswith("clouds in the world already") for warning in found.warnings)


def test_a_folder_of_scans_by_columns_is_refused(tmp_path: Path) -> None:
    points_m = scan(64, ground_m=0.0)
    rows = np.column_stack([points_m, np.ones(len(points_m))]).astype("<f4")
    rows.T.tofile(tmp_path / "100.0.bin")
    with one_line(LogError, "holds all x, then all y, then all z"):
        inspect(tmp_path)


@pytest.mark.parametrize(
    "name", ["poses.txt", "00.txt", "groundtruth.csv", "times.txt", "path.tum"]
)
def test_the_format_of_poses_is_known_by_their_columns(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("".join(f"{100 + i} {i} 0 0 0 0 0 1\n" for i in range(5)))
    assert "TUM trajectory" in inspect(tmp_path / name).headline
    (tmp_path / name).write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(5)))
    assert "KITTI ground truth" in inspect(tmp_path / name).headline


def test_a_warning_says_that_poses_are_no_vehicles(tmp_path: Path) -> None:
    """The quaternion is written w first: the body hangs upside down."""
    (tmp_path / "poses.txt").write_text("".join(f"{100 + i} {i} 0 0 1 0 0 0\n" for i in range(5)))
    warnings = inspect(tmp_path / "poses.txt").warnings
    assert any("tilted by up to 180°" in warning for warning in warnings)
