"""A further day is aligned with the map of the training day, and its poses are read from the
artifact."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.errors import LogError
from pipeline.core.frames import distance_and_turn, interpolate
from pipeline.core.progress import Progress
from pipeline.readers.estimated import with_estimated_poses
from pipeline.slam.onto import estimate_onto
from pipeline.slam.summary import lines
from tests.slam.round import QUICK, circle, drive

pytest.importorskip("gtsam")

COUNT = 40


def test_a_further_day_is_located_on_the_map_and_its_artifact_gives_a_log_these_poses(
    tmp_path: Path,
) -> None:
    """It begins 10 m farther on, drives the other way, and has its own odometry."""
    later_poses = circle(COUNT)[10:34][::-1]
    later = drive(later_poses)
    estimate = estimate_onto(QUICK, later, drive(circle(COUNT)), circle(COUNT), Progress())
    assert len(estimate.fixed) >= 2
    assert distance_and_turn(estimate.world_T_scan, later_poses)[0].max() < 0.2
    assert any("were found on the map" in line for line in lines(estimate))

    path = tmp_path / "later.zarr"
    store.write(path, estimate)
    np.testing.assert_array_equal(
        store.read(path, schemas.Estimates).world_T_scan, estimate.world_T_scan
    )
    log = with_estimated_poses(later, path)
    np.testing.assert_array_equal(log.world_T_scan, estimate.world_T_scan)
    np.testing.assert_array_equal(log.odom_T_scan, estimate.odom_T_scan)
    with pytest.raises(LogError, match="is of another log"):
        with_estimated_poses(drive(circle(5)), path)


def test_scans_without_a_pose_are_left_out_and_counted(tmp_path: Path) -> None:
    """The fifth of ten scans has no pose and is left out."""
    estimate = QUICK.estimate(drive(circle(10)), Progress())
    world_T_scan = estimate.world_T_scan.copy()
    world_T_scan[4] = np.nan
    path = tmp_path / "day.zarr"
    store.write(path, replace(estimate, world_T_scan=world_T_scan))
    log = with_estimated_poses(drive(circle(10), circle(10)), path)
    assert len(log.stamps_ns) == 9
    assert log.skipped == {"no pose by slam": 1}
    assert np.isfinite(
        log.odom_T_scan
    ).all()  # the log's own odometry, which goes on over the fifth
    assert len(log.points(8)) == len(drive(circle(10)).points(9))


def test_scans_are_deskewed_to_their_stamps(tmp_path: Path) -> None:
    """All points are measured half a step after the stamp, when the robot is .5 m farther on."""
    estimate = QUICK.estimate(drive(circle(6)), Progress())
    store.write(tmp_path / "day.zarr", estimate)
    skewed = replace(
        drive(circle(6)),
        times_s=lambda row: np.full(len(drive(circle(6)).points(row)), 0.25),
    )
    log = with_estimated_poses(skewed, tmp_path / "day.zarr")
    assert log.times_s(2) is None
    half = interpolate(circle(6)[2:3], circle(6)[3:4], np.array([0.5]))[0]
    scan_T_last = np.linalg.inv(circle(6)[2]) @ half
    expected_m = skewed.points(2) @ scan_T_last[:3, :3].T + scan_T_last[:3, 3]
    off_m = np.linalg.norm(log.points(2) - expected_m, axis=1)
    skew_m = np.linalg.norm(skewed.points(2) - expected_m, axis=1)
    assert np.median(off_m) < 0.1 < 0.4 < np.median(skew_m)


def test_a_day_elsewhere_is_refused() -> None:
    elsewhere = drive(circle(12), seed=7)
    with pytest.raises(LogError, match="none of 12 scans was found on the map"):
        estimate_onto(QUICK, elsewhere, drive(circle(COUNT)), circle(COUNT), Progress())
