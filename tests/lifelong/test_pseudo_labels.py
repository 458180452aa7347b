"""A site pseudo-labels the scans whose fix it accepts, and the scans between two such fixes."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import Trajectory
from pipeline.lifelong.pseudo_labels import (
    PseudoLabels,
    bridge,
    from_site,
    own_poses,
    poses_at,
    with_reference_poses,
)
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Site
from tests.online.made import ANCHORS, packed
from tests.posing.scene import planar, scene, seen_from


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return Site.open(packed(tmp_path_factory.mktemp("site")))


def scan(x_m: float, cloud: int = 0, ground_truth: bool = True) -> Scan:
    """A scan `x_m` along x in the first place; with another `cloud` than 0 the place has
    changed."""
    points_m = seen_from(scene(cloud), planar(x_m, 0, 0))
    pose = ANCHORS[0] @ planar(x_m, 0, 0)
    true = pose if ground_truth else NO_POSE
    return Scan(f"{x_m}", int(1e9 * x_m), lambda: points_m, planar(x_m, 0, 0), true)


def xs(labels: PseudoLabels) -> list[float]:
    """How far along x in the first place the pseudo-labelled scans lie, in metres."""
    return np.round(labels.world_T_scan[:, 0, 3] - ANCHORS[0, 0, 3], 1).tolist()


def test_scans_between_two_accepted_fixes_are_pseudo_labelled_by_odometry(
    site: Site,
) -> None:
    drive = [scan(0), scan(1), scan(2, cloud=9), scan(3, cloud=9), scan(4), scan(5)]
    labels = from_site(site, drive)
    assert xs(labels) == [0, 1, 2, 3, 4, 5]
    assert labels.scan_count == 6
    assert not labels.wrong.any()
    assert not labels.has_reference_poses
    assert (labels.probability > 0.9).all()
    without_odometry = [replace(scan, odom_T_scan=NO_POSE) for scan in drive]
    assert xs(from_site(site, without_odometry)) == [0, 1, 4, 5]


def test_scans_too_near_the_last_one_are_left_out_and_wrong_poses_counted(site: Site) -> None:
    wrong = Scan("w", 0, scan(0).points, NO_POSE, planar(9, 9, 0))
    labels = from_site(site, [scan(0), scan(0.4), scan(1.2), wrong])
    assert xs(labels) == [0, 1.2, 0]
    assert labels.wrong.tolist() == [False, False, True]


def test_a_day_without_an_accepted_fix_is_refused(site: Site) -> None:
    with pytest.raises(LogError, match=r"nothing to learn of 2 scans: no fix is accepted"):
        from_site(site, [scan(0, cloud=7), scan(1, cloud=8)])


def test_poses_are_those_of_a_reference_at_the_stamps_or_the_logs_own() -> None:
    drive = [scan(x) for x in (0.0, 1.0, 2.0)]
    poses = Trajectory(np.array([0, 10**9]), np.array([planar(50, 0, 0), planar(51, 0, 0)]), 1.0)
    labels = with_reference_poses(drive, poses_at(drive, poses))
    assert labels.world_T_scan[:, 0, 3].tolist() == [50, 51]
    assert labels.has_reference_poses
    assert labels.scan_count == 3
    assert xs(with_reference_poses(drive, own_poses(drive))) == [0, 1, 2]
    with pytest.raises(LogError, match="the reference poses cover none"):
        with_reference_poses(drive[:1], np.array([NO_POSE]))


def test_the_error_of_odometry_is_spread_over_the_gap() -> None:
    # Four scans are a metre apart by odometry. The last fix lies .3 m to the left of where odometry
    # ends, so the two between are moved by .1 and .2 m.
    odometry = np.array([planar(x, 0, 0) for x in (0.0, 1.0, 2.0, 3.0)])
    poses = np.array([planar(10, 0, 0), NO_POSE, NO_POSE, planar(13, 0.3, 0)])
    probability = np.array([0.999, 0, 0, 0.99])
    bridge(poses, probability, odometry)
    np.testing.assert_allclose(poses[:, :2, 3], [(10, 0), (11, 0.1), (12, 0.2), (13, 0.3)])
    assert probability.tolist() == [0.999, 0.99, 0.99, 0.99]


@pytest.mark.parametrize("end", [planar(13, 2.5, 0), planar(13, 0, 6)])
def test_a_gap_stays_where_odometry_misses_the_next_fix(end: np.ndarray) -> None:
    poses = np.array([planar(10, 0, 0), NO_POSE, end])
    probability = np.array([1.0, 0, 1])
    bridge(poses, probability, np.array([planar(x, 0, 0) for x in (0.0, 1.5, 3.0)]))
    assert np.isnan(poses[1]).all()
    assert probability[1] == 0


def test_a_gap_stays_where_odometry_is_interrupted() -> None:
    poses = np.array([planar(10, 0, 0), NO_POSE, planar(12, 0, 0)])
    probability = np.array([1.0, 0, 1])
    bridge(poses, probability, np.array([planar(0, 0, 0), NO_POSE, planar(2, 0, 0)]))
    assert np.isnan(poses[1]).all()
