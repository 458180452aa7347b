"""`yearloc calibrate` of a site that learned a drive: a later day teaches thresholds again."""

import shutil
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.progress import Progress
from pipeline.lifelong.calibration import calibration, confirmed
from pipeline.online import site_file
from pipeline.online.description import describe
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Site
from tests.commands import Command
from tests.online.made import packed, scan
from tests.posing.scene import planar

DAY = "tuesday"
POSITIONS_M = ((-6.0, -3.0), (-6.0, 3.0), (0.0, 0.0), (6.0, -3.0), (6.0, 3.0))
"""Where the robot stands in each place, from its anchor."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five scans in each of the three places, 6 m or more from one to the next: 15 blocks."""
    folder = tmp_path_factory.mktemp("drives") / DAY
    folder.mkdir()
    rows = []
    for number, (place, (x_m, y_m)) in enumerate(product(range(3), POSITIONS_M)):
        points_m, pose = scan(place, x_m, y_m, yaw_deg=20.0 * number)
        np.save(folder / f"{number:03d}.npy", points_m.astype(np.float32))
        rows.append(" ".join(map(str, pose[:3].ravel())))
    folder.with_suffix(".txt").write_text("\n".join(rows) + "\n")
    return folder


def test_a_later_day_teaches_what_it_has_blocks_for_and_the_rest_stays(
    three_places: Path, log: Path, tmp_path: Path, yearloc: Command
) -> None:
    """12 of 15 blocks are seen: .9 takes 9, .95 takes 19. The site's own day had none for .999."""
    out = tmp_path / "calibrated.site"
    poses = log.with_suffix(".txt")
    said, _ = yearloc.run("calibrate", three_places, log, "--poses", poses, "-o", out)
    assert "15 of 15 scans with a reference pose have a right fix; 15 validation blocks" in said
    assert "learned: 0.9; by the site's own thresholds: 0.95, 0.97, 0.98, 0.985, 0.99" in said
    before = site_file.read(three_places).description
    after = site_file.read(out).description
    assert (after.verdict.pose, after.verdict.place) == (before.verdict.pose, before.verdict.place)
    assert after.verdict.claim_thresholds["fix"][1:] == (0.5, *4 * [0.1], -1, -1)
    assert after.verdict.claim_thresholds["fix"][0] >= 0.5
    (day,) = after.calibrated_days
    assert (day.day, day.blocks, day.target_precisions) == (DAY, 15, (0.9,))
    assert not day.has_covariances
    assert "calibrated on tuesday" in str(describe(out))
    assert "15 blocks taught the thresholds of .9; the other thresholds were" in str(describe(out))
    assert Site.open(out).localize(scan()[0], 0.9).verdict == "accepted"


def test_a_second_day_is_kept_beside_the_first(
    three_places: Path, log: Path, tmp_path: Path, yearloc: Command
) -> None:
    first, second = tmp_path / "first.site", tmp_path / "second.site"
    poses = log.with_suffix(".txt")
    wednesday = Path(shutil.copytree(log, tmp_path / "wednesday"))
    yearloc.run("calibrate", three_places, wednesday, "--poses", poses, "-o", first)
    yearloc.run("calibrate", first, log, "--poses", poses, "-o", second)
    days = site_file.read(second).description.calibrated_days
    assert [day.day for day in days] == ["wednesday", DAY]
    assert "calibrated on wednesday" in str(describe(second))
    assert "calibrated on tuesday" in str(describe(second))


def test_fixes_that_odometry_and_others_confirm_teach_too(three_places: Path) -> None:
    """Six scans in steps of a metre; those at both ends have no fix on one side, and 3 m are one
    block."""
    site = Site.open(three_places)
    scans = []
    for number in range(6):
        points_m, pose = scan(1, x_m=number - 3.0, y_m=1.0, yaw_deg=0.0)
        odom_T_scan = planar(7, 1, 30) @ pose
        scans.append(Scan("", None, partial(np.asarray, points_m), odom_T_scan, NO_POSE))
    learned = calibration(site, scans, confirmed(site, scans, 0.95), Progress())
    assert (learned.scans, learned.right, learned.blocks) == (4, 4, 1)
    assert learned.learned == ()
    assert "by the site's own thresholds: 0.9, 0.95" in learned.line("monday")


def test_the_day_that_the_site_learned_calibrates_nothing(
    tmp_path: Path, log: Path, yearloc: Command
) -> None:
    provenance = {"train": DAY, "md5": {}, "versions": {}}
    site = packed(tmp_path, provenance=provenance)
    before = site.read_bytes()
    assert "tuesday: the site learned this day" in yearloc.refused(
        "calibrate", site, log, "--poses", log.with_suffix(".txt")
    )
    assert site.read_bytes() == before


def test_a_site_without_a_calibrated_day_is_written_and_read_as_before(three_places: Path) -> None:
    """Files of an earlier yearloc do not have the key."""
    assert site_file.read(three_places).description.calibrated_days == ()
    assert "calibrated on" not in str(describe(three_places))
