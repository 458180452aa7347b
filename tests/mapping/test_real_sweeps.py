"""Submaps of what readers give: of real KITTI scans, and of a bag of laser scans."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from omegaconf import OmegaConf
from scipy.spatial import cKDTree

from pipeline.core import store
from pipeline.core.compute import Compute
from pipeline.core.errors import ArtifactError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Scans
from pipeline.formats.bag import BagWriter
from pipeline.mapping.gathering import Gathering
from pipeline.mapping.scans import Intake
from pipeline.mapping.submaps import Accumulated
from pipeline.readers.bag import Bag
from pipeline.readers.kitti import Kitti
from pipeline.readers.log import Log
from pipeline.views.scan_context import ScanContext
from stages.views import main

ROOT = Path(__file__).parents[2]


def taken(path: Path, log: Log) -> store.Artifact:
    """Write a log as a scans artifact, and open it."""
    intake = Intake(log, 0.005, 0)
    with store.draft(
        path, Scans, grain_m=0.005, skipped=intake.skipped, clipped=intake.clipped
    ) as draft:
        for points, offsets in intake.blocks(Compute(), Progress()):
            draft.append("points", points)
            draft.append("offsets", offsets)
        for name, column in intake.poses().items():
            draft.put(name, column)
    return store.read(path, Scans)


@pytest.mark.parametrize(("newest", "median_m"), [(1, 0.07), (15, 0.34)])
def test_real_scans_lie_on_each_other_in_a_submap(
    real: Path, tmp_path: Path, newest: int, median_m: float
) -> None:
    # real/README.md: points above z = −1 m of scan j, seen from scan 0; how they were cut is not
    # said, so a quarter is allowed.
    scans = taken(tmp_path / "00.zarr", Kitti().open(real / "kitti", "00"))
    used = np.isin(np.arange(16), (0, newest))
    oldest = np.array([0])
    last = np.array([newest])
    (points,) = Gathering(scans, "world_T_scan", oldest, last, np.zeros(1), used)
    ends = scans.load("offsets")
    older = points[: ends[1]]
    newer = points[ends[1] :]
    assert len(newer) == ends[newest + 1] - ends[newest]
    above = [cloud[cloud[:, 2] > -1 + Kitti().lidar_height_m] for cloud in (older, newer)]
    assert np.median(cKDTree(above[0]).query(above[1])[0]) == pytest.approx(median_m, rel=0.25)


def test_laser_scans_of_a_bag_become_submaps(tmp_path: Path) -> None:
    """A robot drives along x at a metre a second. Its lidar, 1 m above the ground, sees one point
    of a wall 5 m to the left in each sweep."""
    lidar = np.eye(4)
    lidar[2, 3] = 1.0
    with BagWriter(tmp_path / "monday", "mcap") as bag:
        bag.static_transform(0, "base_link", "laser", lidar)
        for step in range(60):
            stamp_ns = 10**9 + step * 10**8
            pose = np.eye(4)
            pose[0, 3] = step / 10
            bag.odometry(stamp_ns, "map", "base_link", pose, "/odom")
            bag.laser_scan(stamp_ns, "laser", np.array([np.inf, 5.0]), 0.0, np.pi / 2, 0.1, 30.0)
    log = Bag(points="/scan", ground_truth="/odom", odometry="/odom").open(tmp_path, "monday")
    scans = taken(tmp_path / "monday.zarr", log)
    flat = yaml.safe_load((ROOT / "conf/submap/flat.yaml").read_text()) | {"window_m": 2.0}
    assert flat.pop("_target_").endswith("Accumulated")
    made = Accumulated(**flat).cut(scans, Progress())
    *_, points = Gathering(scans, made.layout, made.first, made.scans, made.ground_m, made.used)
    np.testing.assert_allclose(points, [[-x / 10, 5, 1] for x in range(20, -1, -1)], atol=0.006)
    assert ScanContext(min_points=1)(points).max() == pytest.approx(1.0, abs=0.006)


def test_views_that_show_nothing_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A level lidar's sweeps seem to be on the ground if their own height is taken for it."""
    monkeypatch.chdir(tmp_path)
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, 0, 3] = np.arange(30)
    thicket = np.mgrid[38:42:0.25, -2:2:0.25].reshape(2, -1).T
    sweep = np.column_stack(
        [np.concatenate([[[4.0, 0.0]], thicket]), np.full(len(thicket) + 1, 0.6)]
    )
    level = Log(np.arange(30), poses, poses, lambda row: sweep, Counter())
    scans = taken(tmp_path / "scans/monday.zarr", level)
    stage = {"sequences": "monday", "scans": "scans", "submaps": "submaps"}
    view = {"_target_": "pipeline.views.scan_context.ScanContext", "rings": 40, "sectors": 120}
    drawn = stage | {
        "out": "views",
        "view": view,
        "compute": {"_target_": "pipeline.core.compute.Compute"},
    }
    for percentile, shows in ((5.0, False), (-1.0, True)):
        made = Accumulated(window_m=5.0, ground_percentile=percentile).cut(scans, Progress())
        store.write("submaps/monday.zarr", made)
        if shows:
            # Of 29 anchors the first four have no whole window.
            assert main.run(OmegaConf.create(drawn)).startswith(
                "monday: 25 views of 40 × 120 (ring, sector)"
            )
        else:
            with pytest.raises(ArtifactError, match="submap: flat"):
                main.run(OmegaConf.create(drawn))
            assert not Path("views").exists()
