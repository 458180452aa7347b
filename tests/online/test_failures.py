"""Failure cards: the fixes whose verdict is wrong are found, the worst first, and drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.evaluation.failures import JudgedFix, failures
from pipeline.mapping.from_above import MAP_GREY
from pipeline.online.failures import draw, of_log
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Site
from tests.commands import Command
from tests.online.made import scan
from tests.posing.scene import planar


def test_only_wrong_verdicts_are_found_the_worst_first(three_places: Path, tmp_path: Path) -> None:
    site = Site.open(three_places)
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
    fixes = [right, wrong, surer, refused, nothing, wrong]
    found = failures(of_log([taken] * 5 + [unknown], fixes))
    assert [(one.kind, one.novelty) for one in found] == [
        ("accepted, and wrong", 0.01),
        ("accepted, and wrong", 0.05),
        ("rejected, and right", right.novelty),
    ]
    assert found[0].off[0] == pytest.approx(30, abs=0.2)
    draw(site.targets, found[0], tmp_path / "card.png", "target precision 0.99")
    card = Image.open(tmp_path / "card.png").convert("RGB")
    picture = np.asarray(card).reshape(-1, 3).astype(int)
    red = (picture[:, 0] - picture[:, 1] > 80).sum()
    grey = (abs(picture - list(bytes.fromhex(MAP_GREY[1:]))) < 4).all(axis=1).sum()
    assert red > 500
    assert grey > 500


def test_a_log_with_true_poses_is_needed(
    three_places: Path, tmp_path: Path, yearloc: Command
) -> None:
    np.save(tmp_path / "1.npy", scan()[0])
    words = ("failures", three_places, "-o", tmp_path / "cards")
    assert "no scan with a true pose" in yearloc.refused(*words, tmp_path / "1.npy")
    assert "say which log" in yearloc.refused(*words)


def test_a_level_pose_is_right_within_limits_of_its_own() -> None:
    """Right is within 1 m and 10° for a level sweep, within 2 m and 5° for a 3-D scan."""
    poses = planar(1.5, 0, 0), planar(0, 0, 0)
    level = JudgedFix("sweep", lambda: np.zeros((0, 3)), *poses, True, 0.9, 0.01, (1.0, 10.0))
    assert level.fails
    assert not replace(level, accepted=False).fails
    turned = replace(level, world_T_found=planar(0.5, 0, 8))
    assert not turned.fails
    assert replace(turned, right_within=(2.0, 5.0)).fails
