"""A drive without poses: `Slam` estimates them, joins its parts, and refuses what it cannot use."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import distance_and_turn
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.formats import folder
from pipeline.readers.folder import read_tum
from pipeline.readers.log import Log
from pipeline.slam import outputs
from pipeline.slam.summary import lines
from tests.slam.round import QUICK, RADIUS_M, ROUND, circle, drive

pytest.importorskip("gtsam")

COUNT = 118
"""Scans: one round and 18 m more."""


@pytest.fixture(scope="module")
def log() -> Log:
    return drive(circle(COUNT))


@pytest.fixture(scope="module")
def estimate(log: Log) -> Estimates:
    return QUICK.estimate(log, Progress())


def off_m(estimate: Estimates, world_T_scan: np.ndarray) -> np.ndarray:
    """The distance (n,) of the poses from the true poses in metres, with both first poses
    aligned."""
    aligned = world_T_scan[0] @ np.linalg.inv(estimate.world_T_scan[0]) @ estimate.world_T_scan
    return distance_and_turn(aligned, world_T_scan)[0]


def test_a_round_without_any_odometry_is_found(estimate: Estimates) -> None:
    assert estimate.posed.all()
    assert not len(estimate.breaks)
    assert off_m(estimate, circle(COUNT)).max() < 0.3


def test_loops_join_the_second_round_with_the_first(estimate: Estimates) -> None:
    """From scan 92 on the drive is within 8 m of its start; of 26 m, some 4 to 6 keys are searched
    for loops."""
    assert len(estimate.used) >= 3
    assert estimate.used.all()
    assert np.abs(estimate.later - estimate.earlier - ROUND).max() <= 12
    ground_truth = np.linalg.inv(circle(COUNT)[estimate.earlier]) @ circle(COUNT)[estimate.later]
    assert distance_and_turn(estimate.earlier_T_later, ground_truth)[0].max() < 0.2
    assert estimate.residual_m.max() < 0.2


def test_the_steps_are_those_of_the_log_where_it_has_odometry() -> None:
    """Odometry that is 2 % too long is only a first guess."""
    odom_T_scan = circle(12)
    odom_T_scan[:, :3, 3] *= 1.02
    estimate = QUICK.estimate(drive(circle(12), odom_T_scan), Progress())
    assert not estimate.by_log.any()
    assert off_m(estimate, circle(12)).max() < 0.1


def test_a_jump_is_a_break_and_is_reported(log: Log) -> None:
    """Scans 30 to 59 are missing: 30 m farther on the robot sees nothing of what it saw before,
    and after 20 m more it has not come round to where it began."""
    rows = np.r_[0:30, 60:80]
    cut = drive(circle(100)[rows], range_m=16.0)
    estimate = QUICK.estimate(cut, Progress())
    assert estimate.breaks.tolist() == [30]
    assert estimate.posed.tolist() == [True] * 30 + [False] * 20
    assert any(line.startswith("no overlap at scan 30: 0.") for line in lines(estimate))
    assert any("drift over" in line and "unknown" in line for line in lines(estimate))


def test_over_a_jump_the_step_of_the_logs_odometry_is_taken() -> None:
    rows = np.r_[0:20, 50:70]
    estimate = QUICK.estimate(drive(circle(100)[rows], circle(100)[rows], range_m=16.0), Progress())
    assert np.flatnonzero(estimate.by_log).tolist() == [20]
    assert off_m(estimate, circle(100)[rows]).max() < 0.3


def test_parts_that_loops_join_are_one_map() -> None:
    """After the jump of scans 40 to 59 the drive goes on and comes round to where it began."""
    rows = np.r_[0:40, 60:132]
    estimate = QUICK.estimate(drive(circle(132)[rows], range_m=16.0), Progress())
    assert estimate.breaks.tolist() == [40]
    assert estimate.posed.all()
    assert off_m(estimate, circle(132)[rows]).max() < 0.5


def test_most_scans_without_points_are_refused() -> None:
    log = drive(circle(10))
    with pytest.raises(LogError, match=r"10 of 10 scans have fewer than 100 voxels"):
        QUICK.estimate(replace(log, points=lambda row: log.points(row)[::200]), Progress())


def test_millimetres_are_refused() -> None:
    log = drive(circle(10))
    with pytest.raises(LogError, match=r"are they in millimetres"):
        QUICK.estimate(replace(log, points=lambda row: 1000 * log.points(row)), Progress())


def test_level_sweeps_are_refused() -> None:
    log = drive(circle(10))
    flat = replace(log, points=lambda row: log.points(row) * np.array([1.0, 1.0, 0.0]))
    with pytest.raises(LogError, match=r"in one plane"):
        QUICK.estimate(flat, Progress())


def test_unreadable_and_empty_scans_are_left_out_and_counted() -> None:
    log = drive(circle(20))

    def points(row: int) -> np.ndarray:
        if row == 7:
            raise LogError("cut short")
        return log.points(row)[: 0 if row == 9 else None]

    estimate = QUICK.estimate(replace(log, points=points), Progress())
    assert estimate.posed.sum() == 18
    assert estimate.skipped == {"too few points": 1, "unreadable scan": 1}
    posed = estimate.posed
    aligned = circle(20)[0] @ np.linalg.inv(estimate.world_T_scan[0]) @ estimate.world_T_scan
    assert distance_and_turn(aligned[posed], circle(20)[posed])[0].max() < 0.2


def test_the_same_log_makes_the_same_poses() -> None:
    log = drive(circle(12))
    first = QUICK.estimate(log, Progress()).world_T_scan
    second = QUICK.estimate(log, Progress()).world_T_scan
    np.testing.assert_array_equal(first, second)


def test_the_trajectory_is_a_tum_file(estimate: Estimates, tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(outputs.tum_text(estimate))
    stamps_ns, poses = read_tum(path)
    np.testing.assert_array_equal(stamps_ns, estimate.stamps_ns)
    np.testing.assert_allclose(poses, estimate.world_T_scan, atol=2e-6)


def test_the_map_holds_the_walls_where_they_stand(log: Log, estimate: Estimates) -> None:
    points_m = np.concatenate([*outputs.slam_map(log, estimate, Progress()).tiles_m()])
    assert np.abs(np.median(points_m[:, 2])) < 2.0
    centre = np.median(points_m[:, :2], axis=0)
    assert np.linalg.norm(centre - [0.0, RADIUS_M]) < 8.0  # the circle's middle, to the left


def test_the_picture_is_a_png(estimate: Estimates, tmp_path: Path) -> None:
    outputs.draw(estimate, tmp_path / "a", "round")
    assert (tmp_path / "a").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("stem", "stamp_ns"),
    [
        ("000012", 12 * 10**9),
        ("cloud_7", 7 * 10**9),
        ("1326652795.280148", 1326652795280148000),
        ("1326652795280148", 1326652795280148000),
        ("1326652795280148123", 1326652795280148123),
        ("scan-1326652795280", 1326652795280 * 10**6),
        ("cloud", None),
    ],
)
def test_a_name_ends_in_a_number_or_a_stamp(stem: str, stamp_ns: int | None) -> None:
    assert folder.stamp_at_end(stem) == stamp_ns
