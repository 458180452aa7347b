"""Tests the NCLT reader on files made by hand, and on a real scan."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import rpy, yaw
from pipeline.readers.nclt import (
    Nclt,
    read_packets,
    read_poses,
    read_uncertainty,
    read_velodyne_sync,
)
from tests.readers.damage import one_line
from tests.readers.logs import DATE, START, nclt_log, packet, sync_bytes
from tests.readers.logs import nclt_row as row

# Scans


def test_raw_words_are_unsigned_half_centimetres_from_minus_100_m(tmp_path: Path) -> None:
    # 20000 is 0 m, 23111 is 15.555 m, 32767 is 63.835 m and 32768, negative if read as signed,
    # 63.84 m; 65535 is 227.675 m and 0 is −100 m. The file's y points right and its z down.
    path = tmp_path / "1.bin"
    hits = (20_000, 20_000, 20_000), (23_111, 32_767, 32_768), (65_535, 0, 65_535)
    path.write_bytes(sync_bytes(*hits))
    found = [[0, 0, 0], [15.555, -63.835, -63.84], [227.675, 100, -227.675]]
    np.testing.assert_allclose(read_velodyne_sync(path), found, atol=1e-9)


def test_a_real_scan_has_its_ground_below_and_its_beams_above(real: Path) -> None:
    points = read_velodyne_sync(real / "nclt/2012-01-15/velodyne_sync/1326652795280148.bin")
    assert points.shape == (23_546, 3)
    near = np.linalg.norm(points[:, :2], axis=1) < 6
    # the body's origin is about on the ground
    assert -0.3 < np.percentile(points[near, 2], 5) < 0.15


# Raw packets


def test_packets_are_found_one_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "velodyne_hits.bin"
    hits = (20_000, 20_200, 19_800, 9, 31), (20_001, 20_000, 20_000, 255, 0)
    last = packet(START + 5, (0, 0, 65_535, 1, 2))
    path.write_bytes(packet(START - 1) + packet(START, *hits) + last)
    found = read_packets(path)
    assert found.utimes.tolist() == [START - 1, START, START + 5]
    assert found.offsets.tolist() == [0, 0, 2, 3]  # the first packet is empty
    assert found.hits(1).tolist() == [
        [20_000, 20_200, 19_800, 9 + 256 * 31],
        [20_001, 20_000, 20_000, 255],
    ]
    assert found.hits(2).tolist() == [[0, 0, 65_535, 1 + 256 * 2]]
    assert found.hits(0).shape == (0, 4)


# Poses


def test_north_east_down_poses_become_z_up(tmp_path: Path) -> None:
    # 1 m north, 2 m east, 3 m down, roll 0.1, pitch 0.2, heading 0.3 clockwise: left and up change
    # sign, so do pitch and yaw.
    path = tmp_path / "groundtruth.csv"
    path.write_text(row(0, 1, 2, 3, 0.1, 0.2, 0.3))
    ground_truth = read_poses(path)
    np.testing.assert_allclose(ground_truth.world_T_body[0, :3, 3], [1, -2, -3])
    np.testing.assert_allclose(rpy(ground_truth.world_T_body), [[0.1, -0.2, -0.3]], atol=1e-12)
    assert ground_truth.stamps_ns.tolist() == [START * 1000]


def test_leading_rows_without_a_pose_are_gaps(tmp_path: Path) -> None:
    path = tmp_path / "groundtruth.csv"
    path.write_text(row(0, *["NaN"] * 6) + row(1, "nan", 0, 0, 0, 0, 0) + row(2) + row(3))
    ground_truth = read_poses(path)
    assert len(ground_truth.stamps_ns) == 4
    assert ground_truth.at(ground_truth.stamps_ns)[1].tolist() == [False, False, True, True]


# Logs


def test_a_scan_between_two_poses_lies_halfway(tmp_path: Path) -> None:
    # 10 m/s north: 0.15 s after the first row, 1.5 m. The hit: 1 m forward, 2 m right, 2 m up.
    log = Nclt().open(nclt_log(tmp_path), DATE)
    assert log.stamps_ns.tolist() == [(START + 150_000) * 1000]
    np.testing.assert_allclose(log.world_T_scan[0, :3, 3], [1.5, 0, 0])
    np.testing.assert_allclose(log.points(0), [[1, -2, 2]])
    assert np.isnan(log.odom_T_scan).all()
    assert log.notes == ("no odometry_mu_100hz.csv",)
    assert not log.skipped
    np.testing.assert_allclose(Nclt(lift_m=0.3).open(tmp_path, DATE).points(0), [[1, -2, 2.3]])


def test_scans_come_in_order_of_time_not_of_name(tmp_path: Path) -> None:
    # As text, "100…" comes before "99…".
    scans = {"1000": sync_bytes((20_200,) * 3), "990": sync_bytes((20_000,) * 3)}
    log = Nclt().open(nclt_log(tmp_path, "900,0,0,0,0,0,0\n1100,1,0,0,0,0,0\n", scans), DATE)
    assert log.stamps_ns.tolist() == [990_000, 1_000_000]
    np.testing.assert_allclose(log.points(0), [[0, 0, 0]], atol=1e-9)


def test_scans_without_a_pose_are_counted(tmp_path: Path) -> None:
    # Rows at 0, 0.1 s, then NaN at 0.2, 0.3, then 2 s later at 2.3 s (a gap: more than half a
    # second) and at 2.4 s.
    ground_truth = row(0) + row(1) + row(2, *["nan"] * 6) + row(3) + row(23) + row(24)
    # Scans before the rows, between known ones, next to and on the NaN row, on the last one, in the
    # gap, in the new rows, after.
    at = (-10, 5, 15, 20, 30, 100, 235, 241)
    scans = {str(START + 10_000 * c): sync_bytes((20_000,) * 3) for c in at}
    log = Nclt().open(nclt_log(tmp_path, ground_truth, scans), DATE)
    assert [(s // 1000 - START) // 10_000 for s in log.stamps_ns.tolist()] == [5, 30, 235]
    assert log.skipped == {"outside the poses' span": 2, "in a gap of the poses": 3}


def test_files_that_are_no_scans_are_counted(tmp_path: Path) -> None:
    good = sync_bytes((20_000,) * 3)
    # 18446744073709552 µs is 2⁶⁴ + 384 ns: wrapped around it would lie within a trajectory that
    # starts at 0. 05 is 5 again.
    names = ("5", "velodyne", "1" * 18, "-7", "18446744073709552", "05")
    scans = dict.fromkeys(names, good) | {"6": b"", "7": good[:-1]}
    log = Nclt().open(nclt_log(tmp_path, "0,0,0,0,0,0,0\n10,1,0,0,0,0,0\n", scans), DATE)
    assert log.stamps_ns.tolist() == [5000]
    assert log.skipped == {"file name is no utime": 5, "empty file": 1, "truncated record": 1}


def test_odometry_is_given_at_the_scans(tmp_path: Path) -> None:
    # The wheels say 1.2 m a tenth, and 30° (clockwise in the file) from the second row to the
    # third.
    odometry = row(0) + row(1, 1.2, 0, 0, 0, 0, 0) + row(2, 2.4, 0, 0, 0, 0, np.pi / 6)
    log = Nclt().open(nclt_log(tmp_path, odometry=odometry), DATE)
    np.testing.assert_allclose(log.odom_T_scan[0, :3, 3], [1.8, 0, 0])
    np.testing.assert_allclose(np.rad2deg(yaw(log.odom_T_scan)), [-15])
    assert log.notes == ()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"ground_truth": None}, "groundtruth_2012-01-08.csv"),
        ({"scans": {}}, "no readable scan"),
        ({"scans": {"1": b""}}, "no readable scan"),
    ],
)
def test_a_log_that_lacks_something_is_refused(
    tmp_path: Path, change: dict[str, object], says: str
) -> None:
    with one_line(LogError, says):
        Nclt().open(nclt_log(tmp_path, **change), DATE)
    (tmp_path / "groundtruth_2012-02-02.csv").write_text(row(0))
    with one_line(LogError, "2012-02-02.*no such folder of scans"):
        Nclt().open(tmp_path, "2012-02-02")


def test_sequences_are_listed_with_what_they_lack(tmp_path: Path) -> None:
    nclt_log(tmp_path)
    (tmp_path / "2012-03-03" / "velodyne_sync").mkdir(parents=True)
    (tmp_path / "else").mkdir()
    assert Nclt().sequences(tmp_path) == {DATE: [], "2012-03-03": ["groundtruth_2012-03-03.csv"]}


def test_ground_truth_is_found_in_its_other_places(tmp_path: Path) -> None:
    nclt_log(tmp_path)
    (tmp_path / "ground_truth").mkdir()
    name = f"groundtruth_{DATE}.csv"
    (tmp_path / DATE / name).rename(tmp_path / "ground_truth" / name)
    assert len(Nclt().open(tmp_path, DATE).stamps_ns) == 1


# Covariance of the odometry


def covariance_row(step: int, x_m2: float, y_m2: float, heading_rad2: float) -> str:
    """A row of odometry_cov.csv, a tenth of a second a step: the upper triangle, row after row."""
    upper = np.zeros(21)
    upper[[0, 6, 20]] = x_m2, y_m2, heading_rad2
    return ", ".join(map(str, [START + 100_000 * step, *upper])) + "\n"


def test_the_variances_of_the_odometry_add_up_over_its_motions(tmp_path: Path) -> None:
    path = tmp_path / "odometry_cov.csv"
    rows = [covariance_row(0, 0, 0, 0), covariance_row(1, 0.1, 0.3, 0.02)]
    path.write_text("".join([*rows, covariance_row(2, 0.2, 0.2, 0.01)]))
    variances = read_uncertainty(path).at(1000 * (START + np.array([0, 100_000, 150_000, 200_001])))
    # (.1 + .3)/2 after the first motion, half of .2 more half a motion on, nothing beyond the end.
    expected = [[0, 0], [0.2, 0.02], [0.3, 0.025], [np.nan, np.nan]]
    np.testing.assert_allclose(variances, expected, atol=1e-12)


@pytest.mark.parametrize("ending", ["", ", 1"])
def test_a_log_has_the_variance_of_its_odometry_or_a_note(tmp_path: Path, ending: str) -> None:
    ground_truth = "".join(row(100_000 * step, step, 0, 0, 0, 0, 0) for step in range(11))
    nclt_log(tmp_path, odometry=ground_truth)
    rows = [covariance_row(step, 0.1, 0.1, 0.1).rstrip("\n") + ending for step in range(100)]
    (tmp_path / DATE / "odometry_cov.csv").write_text("\n".join(rows))
    log = Nclt().open(tmp_path, DATE)
    assert (log.odom_variance is None) == bool(ending)
    assert any("expected 22 numbers a row" in note for note in log.notes) == bool(ending)
