"""Bird-views of submaps, drawn from a map of all scans before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.views.mapped import MappedViews, motion_variances
from tests.views.made import ALONG, BIRDVIEW, lit, poles


def views(
    folder: Path, known: tuple[bool, ...] = (True, True, True), ground_m: float = 0.0
) -> np.ndarray:
    """The images of three scans; `known` says which of them have odometry."""
    odom_T_scan = np.where(np.array(known)[:, None, None], ALONG, np.nan)
    return np.stack(list(MappedViews(*poles(folder, odom_T_scan, ground_m=ground_m), BIRDVIEW)))


def test_a_pole_seen_once_stays_and_comes_nearer_as_the_robot_drives(tmp_path: Path) -> None:
    images = views(tmp_path)
    assert lit(images) == [1, 2, 3]
    # pole 0 is 4.25 m ahead, then 3.25: the image's middle is row 8, so rows 8 − 5 and 8 − 4; y =
    # 0.25 m is left of the middle
    assert images[0, 0].argmax() == 3 * 16 + 7
    assert images[2, 0, 4, 7] == images[0, 0].max()


def test_a_log_without_odometry_is_placed_by_its_ground_truth(tmp_path: Path) -> None:
    assert lit(views(tmp_path, known=(False, False, False))) == [1, 2, 3]


@pytest.mark.parametrize(("unknown", "seen"), [(0, [1, 1, 2]), (1, [1, 1, 1]), (2, [1, 2, 1])])
def test_a_break_in_the_odometry_begins_a_new_map(
    tmp_path: Path, unknown: int, seen: list[int]
) -> None:
    assert lit(views(tmp_path, known=tuple(row != unknown for row in range(3)))) == seen


def test_what_the_odometry_gathers_between_two_scans_is_said_of_that_motion() -> None:
    # From .5 to .75 m² and from .1 to .3 rad²; nothing before the first scan, none where one of the
    # two does not grow, or is not known.
    gathered = np.array([[0.5, 0.1], [0.75, 0.3], [0.75, 0.4], [1.0, np.nan], [2.0, 0.5]])
    none, said, still, unknown, after = motion_variances(gathered)
    assert said == pytest.approx((0.25, 0.2))
    assert none is still is unknown is after is None


def test_a_map_forgets_what_its_odometry_is_unsure_of(tmp_path: Path) -> None:
    # Half a metre a scan: of σ = 5 cm ten deviations, exp(−50), so that each scan is seen alone; of
    # σ = 5 m a tenth, exp(−.005).
    view = replace(BIRDVIEW, octree=replace(BIRDVIEW.octree, motion="gaussian", sigma="log"))
    for sigma_m, seen in ((0.05, [1, 1, 1]), (5.0, [1, 2, 3])):
        gathered = np.outer(np.arange(3), (sigma_m**2, 1.0))
        (tmp_path / str(sigma_m)).mkdir()
        drive = poles(tmp_path / str(sigma_m), odom_variance=gathered)
        assert lit(np.stack(list(MappedViews(*drive, view)))) == seen


def test_heights_count_from_the_submaps_ground(tmp_path: Path) -> None:
    """With the ground at 2.5 m, the tops of the poles at 2.75 m are no longer above 0.3 m."""
    assert lit(views(tmp_path, ground_m=2.5)) == [0, 0, 0]
