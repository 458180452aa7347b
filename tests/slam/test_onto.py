"""Further days: laid onto the map of the training day."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.errors import LogError
from pipeline.core.frames import apart
from pipeline.core.progress import Progress
from pipeline.readers.estimated import posed
from pipeline.slam.drive import Slam
from pipeline.slam.kept import artifact
from pipeline.slam.onto import estimate_onto
from tests.slam.round import circle, drive

pytest.importorskip("gtsam")

COUNT = 40


def test_a_further_day_is_laid_onto_the_map_and_kept(tmp_path: Path) -> None:
    """It begins 10 m on, drives the other way, and its odometry knows no world."""
    later_poses = circle(COUNT)[10:34][::-1]
    later = drive(later_poses)
    estimate = estimate_onto(Slam(), later, drive(circle(COUNT)), circle(COUNT), Progress())
    assert len(estimate.fixed) >= 2
    assert apart(estimate.world_T_scan, later_poses)[0].max() < 0.2
    assert any("were found on the map" in line for line in estimate.lines())

    path = tmp_path / "later.zarr"
    store.write(path, artifact(estimate))
    np.testing.assert_array_equal(
        store.read(path, schemas.Estimates).world_T_scan, estimate.world_T_scan
    )
    log = posed(later, path)
    np.testing.assert_array_equal(log.world_T_scan, estimate.world_T_scan)
    np.testing.assert_array_equal(log.odom_T_scan, estimate.odom_T_scan)
    with pytest.raises(LogError, match="is of another log"):
        posed(drive(circle(5)), path)


def test_scans_without_a_pose_are_counted_and_break_the_odometry(tmp_path: Path) -> None:
    """Of ten scans the fifth has no pose: the sixth begins the odometry anew."""
    estimate = Slam().estimate(drive(circle(10)), Progress())
    world_T_scan = estimate.world_T_scan.copy()
    world_T_scan[4] = np.nan
    written = artifact(estimate)
    columns = {**written.arrays, "world_T_scan": world_T_scan}
    path = tmp_path / "day.zarr"
    with store.draft(path, schemas.Estimates, skipped={}) as out:
        for name, column in columns.items():
            out.put(name, column)
    log = posed(drive(circle(10), circle(10)), path)
    assert len(log.stamps_ns) == 9
    assert log.skipped == {"no pose by slam": 1}
    assert np.isfinite(log.odom_T_scan).all()  # its own, which knows the fifth too
    assert len(log.points(8)) == len(drive(circle(10)).points(9))


def test_scans_are_handed_on_as_they_lay_at_their_stamp(tmp_path: Path) -> None:
    """Points measured half a step after the stamp lie half a step on: .5 m of 1 m."""
    estimate = Slam().estimate(drive(circle(6)), Progress())
    store.write(tmp_path / "day.zarr", artifact(estimate))
    skewed = replace(
        drive(circle(6)),
        times_s=lambda row: np.linspace(0, 0.25, len(drive(circle(6)).points(row))),
    )
    log = posed(skewed, tmp_path / "day.zarr")
    assert log.times_s(2) is None
    moved_m = np.linalg.norm(log.points(2) - skewed.points(2), axis=1)
    assert moved_m[0] < 0.02
    assert moved_m[-1] > 0.4


def test_a_day_elsewhere_is_refused() -> None:
    elsewhere = drive(circle(12), seed=7)
    with pytest.raises(LogError, match="none of 12 scans was found on the map"):
        estimate_onto(Slam(), elsewhere, drive(circle(COUNT)), circle(COUNT), Progress())
