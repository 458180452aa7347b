"""A campus drive recorded as ROS bags, and read back by the bag reader."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from pipeline.core.compute import Compute
from pipeline.core.progress import Progress
from pipeline.readers.bag import Bag
from pipeline.readers.deskew import deskewed
from pipeline.readers.log import Log
from pipeline.readers.nclt import Nclt
from tests.worlds.helpers import contents, preset, record, refused
from worlds.simulation import Simulation

SEQUENCE = "2012-06-15"
READER = Bag(ground_truth="/ground_truth", odometry="/odom", max_gap_s=4.0)


@pytest.fixture(scope="module")
def nclt(small: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The same drive, recorded and read as NCLT files."""
    root = tmp_path_factory.mktemp("nclt")
    record(small, SEQUENCE, root)
    return Nclt(max_gap_s=4.0).open(root, SEQUENCE)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_bag_holds_the_drive_that_nclts_files_hold(
    small: Simulation, nclt: Log, tmp_path: Path, kind: str
):
    record(replace(small, logs=kind), SEQUENCE, tmp_path, compute=Compute(workers=2))
    log = READER.open(tmp_path, SEQUENCE)
    assert log.stamps_ns.tolist() == nclt.stamps_ns.tolist()
    assert log.world_T_scan == pytest.approx(nclt.world_T_scan, abs=1e-6)
    assert log.odom_T_scan == pytest.approx(nclt.odom_T_scan, abs=1e-6)
    assert log.odom_variance is not None
    assert log.odom_variance == pytest.approx(nclt.odom_variance, rel=1e-6)
    assert (np.diff(log.odom_variance, axis=0) > 0).all()
    for row in (0, len(log.stamps_ns) - 1):
        # NCLT's grain is 5 mm.
        assert log.points(row) == pytest.approx(nclt.points(row), abs=0.0026)
    assert log.skipped == {}


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_bags_bytes_are_the_same_however_computed_and_in_order_of_time(
    small: Simulation, tmp_path: Path, kind: str
):
    world = replace(small, logs=kind, route_m=40.0)
    for name, workers in (("one", 1), ("two", 2)):
        world.record(SEQUENCE, tmp_path / name, Compute(workers=workers), Progress())
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert len(contents(tmp_path / "one")) == (1 if kind == "ros1" else 2)
    from rosbags.highlevel import AnyReader

    with AnyReader([tmp_path / "one" / ("bag.bag" if kind == "ros1" else "bag")]) as reader:
        stamps_ns = [stamp for _, stamp, _ in reader.messages()]
        topics = {connection.topic: connection.msgcount for connection in reader.connections}
    assert (np.diff(stamps_ns) >= 0).all()
    # 40 m with a scan every 4 m
    assert (topics["/points"], topics["/tf_static"]) == (10, 1)
    assert topics["/ground_truth"] == topics["/odom"] > 100


def test_a_bag_taken_on_the_move_says_when_each_point_was_measured(tmp_path: Path):
    """A scan takes 0.1 s. As measured, its points are off by up to 0.8 m; with the true motion of
    the car taken out, they lie where a car that stands still has them."""
    world = replace(preset("drive_10hz"), azimuths=720, route_m=4.0)
    record(world, "00", tmp_path / "moving")
    record(replace(world, turn_s=0.0), "00", tmp_path / "still")
    moving, still = (
        Bag(ground_truth="/ground_truth", odometry="/odom").open(tmp_path / name, "00")
        for name in ("moving", "still")
    )
    times_s = moving.times_s(2)
    assert still.times_s(2) is None
    assert times_s is not None
    assert len(times_s) == len(moving.points(2))
    assert (times_s.min(), times_s.max()) == pytest.approx((0.0, 0.1 * 719 / 720))
    step = np.linalg.inv(moving.world_T_scan[2]) @ moving.world_T_scan[3]
    tree = KDTree(still.points(2))
    near = np.linalg.norm(moving.points(2), axis=1) < 15
    off_m = tree.query(moving.points(2))[0][near]
    off_deskewed_m = tree.query(deskewed(moving.points(2), times_s, step, 0.1))[0][near]
    assert np.percentile(off_deskewed_m, 75) < 0.1 < np.percentile(off_m, 75)


def test_only_bags_hold_times_of_points():
    with refused("logs=kitti have no times of points"):
        replace(preset("suburb_tiny"), turn_s=0.1)
