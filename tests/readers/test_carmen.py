"""Tests the CARMEN reader: sweeps, corrected poses, odometry, and stamps that stand still."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import yaw
from pipeline.readers.carmen import Carmen
from tests.readers.damage import one_line, opened
from tests.readers.logs import carmen_log, flaser


def test_a_corrected_log_has_its_ground_truth_in_its_sweeps_and_drifts_between_them(
    tmp_path: Path,
) -> None:
    log = opened(Carmen(), carmen_log(tmp_path), "drive")
    assert log is not None
    assert log.stamps_ns.tolist() == [10**9 * i for i in range(10, 16)]
    assert log.world_T_scan[:, :3, 3].tolist() == [[i, 0, 0] for i in range(6)]
    assert np.isnan(log.odom_T_scan[0]).all()  # no reading came before the first sweep
    # Each stretch of odometry is 1.5 m along x and a quarter along y; the step back to the ground
    # truth is no motion.
    steps_m = np.diff(log.odom_T_scan[1:, :2, 3], axis=0)
    assert steps_m == pytest.approx(np.tile([1.5, 0.25], (4, 1)))
    # the third beam, of 50 m, hit nothing
    assert log.points(0) == pytest.approx(np.array([[0, -1, 7], [2, 0, 7]]))
    assert log.notes == ("6 of 18 ranges reached the laser's limit of 49.98 m: no hits",)


def test_the_step_to_a_correction_is_no_motion_whichever_laser_it_follows(tmp_path: Path) -> None:
    first, *before, after, last = [f"ODOM {x} 0 0 1 0 0 1 host 1\n" for x in (0, 0, 1, 5, 6)]
    start = [first, flaser([1], "0 0 0", 1), *before]
    end = [flaser([1], "5 0 0", 2, kind="RLASER"), after, last, flaser([1], "6 0 0", 3)]
    (tmp_path / "a.log").write_text("".join([*start, *end]))
    log = opened(Carmen(), tmp_path, "a")
    assert log is not None
    # a metre before the rear sweep's correction and one after
    assert log.odom_T_scan[:, 0, 3].tolist() == [0, 2]


def test_sweeps_are_counted_where_stamps_stand_still(tmp_path: Path) -> None:
    log = opened(Carmen(sweep_s=2), carmen_log(tmp_path, stamps=False), "drive")
    assert log is not None
    assert log.stamps_ns.tolist() == [2 * 10**9 * i for i in range(6)]
    assert "its stamps stand still: sweeps are counted, 2 s each" in log.notes


def test_sweeps_are_counted_where_stamps_are_too_coarse_to_distinguish_them(tmp_path: Path) -> None:
    # as seconds of ten digits written with six: 1.13486e+09 three times, then 1.13487e+09
    stamps = ("1.13486e+09", "1.13486e+09", "1.13486e+09", "1.13487e+09")
    lines = [flaser([1], f"{x} 0 0", stamp) for x, stamp in enumerate(stamps)]
    (tmp_path / "a.log").write_text("".join(lines))
    log = opened(Carmen(), tmp_path, "a")
    assert log is not None
    assert log.world_T_scan[:, 0, 3].tolist() == [0, 1, 2, 3]
    assert "its stamps stand still: sweeps are counted, 1 s each" in log.notes


def test_newer_records_hold_angles_and_the_largest_range(tmp_path: Path) -> None:
    new = "ROBOTLASER1 0 -1.5707963267948966 3.14 1.5707963267948966 20 0.01 0 4 1 2 20 nan 1 7 "
    poses = "1.5 2 1.5707963267948966 1 2 1.5707963267948966 "
    cut = f"{new}{poses}0 0\n"
    (tmp_path / "new.log").write_text(f"{new}{poses}0 0 0.5 0.5 1e6 3.5 host 3.5\n{cut}")
    log = opened(Carmen(lift_m=0), tmp_path, "new")
    assert log is not None
    assert log.skipped == {"broken record": 1}
    assert yaw(log.world_T_scan) == pytest.approx(np.pi / 2)
    # The laser stands .5 m along the world's x, which is to the right of a robot that looks along
    # y.
    assert log.points(0) == pytest.approx(np.array([[0, -1.5, 0], [2, -0.5, 0]]))


def test_a_corrected_log_beside_a_raw_one_holds_the_ground_truth(tmp_path: Path) -> None:
    raw = [flaser([1, 2], f"{i} {0.1 * i} 0", 5 + i) for i in range(4)]
    rear = flaser([3], "9 9 9", 5.5, kind="RLASER")
    (tmp_path / "a.log").write_text("".join([raw[0], rear, *raw[1:]]))
    corrected = "".join(flaser([], f"{i} 0 0", 5 + i) for i in (0, 1, 3))
    (tmp_path / "a.gfs.log.gz").write_bytes(gzip.compress(corrected.encode()))
    reader = Carmen(corrected="{sequence}.gfs.log.gz")
    assert reader.sequences(tmp_path) == {"a": []}
    log = opened(reader, tmp_path, "a")
    assert log is not None
    assert log.skipped == {"no corrected pose": 1, "sweep of another laser, or without beams": 1}
    assert np.isnan(log.world_T_scan[2]).all()
    assert log.world_T_scan[3, :3, 3].tolist() == [3, 0, 0]
    assert log.odom_T_scan[:, 1, 3] == pytest.approx(0.1 * np.arange(4))
    assert Carmen(corrected="{sequence}.none.log").sequences(tmp_path)["a"] == ["a.none.log"]


def test_a_note_says_that_a_log_may_be_raw(tmp_path: Path) -> None:
    lines = [
        f"ODOM {i} 0 0 1 0 0 {i} host {i}\n{flaser([1], f'{i + 0.5} 0 0', i)}" for i in range(1, 5)
    ]
    (tmp_path / "raw.log").write_text("".join(lines))
    assert "is it a raw log?" in Carmen().open(tmp_path, "raw").notes[-1]


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        (
            "a.log",
            b"ODOM 1 2 3\n",
            "no readable FLASER, RLASER, ROBOTLASER1, ROBOTLASER2 record; is it a CARMEN log?",
        ),
        ("a.log", flaser([1], "0 0 0", 1, kind="RLASER").encode(), "no sweep of a front laser"),
        ("a.log", flaser([1], "0 0 0", 1e30).encode(), "stamped 1e"),
        ("a.log", flaser([1], "1e9 0 0", 1).encode(), "lies nowhere on Earth"),
        ("a.log.gz", b"no gzip", "no whole gzip file"),
        ("a.log.gz", gzip.compress(bytes(999), mtime=0)[:-9], "no whole gzip file"),
        ("b.log", b"", "no such log"),
    ],
)
def test_a_broken_log_raises_an_error_of_one_line(
    tmp_path: Path, name: str, data: bytes, says: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with one_line(LogError, says):
        Carmen().open(tmp_path, "a")


def test_freiburgs_campus_is_as_measured(real: Path) -> None:
    log = Carmen().open(real / "carmen", "freiburg-campus-corrected")
    xy_m = log.world_T_scan[:, :2, 3]
    drifted_m = log.odom_T_scan[:, :2, 3]
    assert len(xy_m) == 2008
    assert np.linalg.norm(np.diff(xy_m, axis=0), axis=1).sum() == pytest.approx(1754, abs=1)
    assert np.linalg.norm(drifted_m[-1] - xy_m[-1]) == pytest.approx(159, abs=1)
    nearest_m = np.linalg.norm(xy_m[1004:, None] - xy_m[:1004], axis=2).min(axis=1)
    assert [(nearest_m < metres).sum() for metres in (1, 3, 10)] == [255, 445, 635]
