"""Failure cards: the fixes whose verdict is wrong are found, the worst first, and drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.cli import main
from pipeline.evaluation.failures import JudgedFix, failures
from pipeline.mapping.from_above import MAP_GREY
from pipeline.online.failures import draw, of_log
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Site
from tests.online.made import packed, scan
from tests.posing.scene import planar


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return Site.open(packed(tmp_path_factory.mktemp("site")))


def test_only_wrong_verdicts_are_found_the_worst_first(site: Site, tmp_path: Path) -> None:
    points_m, world_T_robot = scan()
    taken = Scan("day 1", None, lambda: points_m, NO_POSE, world_T_robot)
    right = site.localize(points_m)
    moved = right.world_T_sensor.copy()
    moved[0, 3] += 30
    wrong = replace(right, world_T_sensor=moved, novelty=0.05)
    surer = replace(right, world_T_sensor=moved, novelty=0.01)
    refused = replace(right, verdict="rejected")
    nothing = replace(right, verdict="no pose")
    unknown = replace(taken, world_T_scan=NO_POSE)
    every = [
        (taken, right),
        (taken, wrong),
        (taken, surer),
        (taken, refused),
        (taken, nothing),
        (unknown, wrong),
    ]
    found = failures(of_log(*zip(*every, strict=True)))  # type: ignore[arg-type]
    assert [(one.kind, one.novelty) for one in found] == [
        ("accepted, and wrong", 0.01),
        ("accepted, and wrong", 0.05),
        ("rejected, and right", right.novelty),
    ]
    assert found[0].off[0] == pytest.approx(30, abs=0.2)
    draw(site.targets, found[0], tmp_path / "card.png", "promise 0.99")
    card = Image.open(tmp_path / "card.png").convert("RGB")
    picture = np.asarray(card).reshape(-1, 3).astype(int)
    red = (picture[:, 0] - picture[:, 1] > 80).sum()
    grey = (abs(picture - list(bytes.fromhex(MAP_GREY[1:]))) < 4).all(axis=1).sum()
    assert red > 500
    assert grey > 500


def test_scans_without_truth_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "1.npy", scan()[0])
    words = [str(packed(tmp_path)), str(tmp_path / "1.npy"), "-o", str(tmp_path / "cards")]
    with pytest.raises(SystemExit):
        main(["failures", *words])
    assert "no scan with a true pose" in capsys.readouterr().err


def test_a_site_needs_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["failures", str(packed(tmp_path)), "-o", str(tmp_path / "cards")])
    assert "say which log" in capsys.readouterr().err


def test_a_level_pose_is_right_within_limits_of_its_own() -> None:
    """Right is within 1 m and 10° for a level sweep, within 2 m and 5° for a 3-D scan."""
    level = JudgedFix(
        "sweep",
        lambda: np.zeros((0, 3)),
        planar(1.5, 0, 0),
        planar(0, 0, 0),
        True,
        0.9,
        0.01,
        (1.0, 10.0),
    )
    assert level.fails
    assert not replace(level, accepted=False).fails
    turned = replace(level, world_T_found=planar(0.5, 0, 8))
    assert not turned.fails
    assert replace(turned, right_within=(2.0, 5.0)).fails
