"""Following a robot: how fixes are accepted along its path, and how it is found again."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.online.site import Site
from pipeline.online.tracking import PATIENCE, Tracker
from tests.online.made import ANCHORS, packed
from tests.posing.scene import planar, scene, seen_from


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return Site.open(packed(tmp_path_factory.mktemp("site")))


def seen(row: int, x_m: float) -> np.ndarray:
    return seen_from(scene(row), planar(x_m, 0, 0))


def test_a_path_is_followed_with_and_without_odometry(site: Site) -> None:
    for step in (planar(0.5, 0, 0), None):
        tracker = Tracker(site)
        assert tracker.mode == "lost"
        for i in range(4):
            fix = tracker.localize(seen(0, 0.5 * i), step)
            assert (fix.verdict, tracker.mode) == ("accepted", "tracking")
            np.testing.assert_allclose(fix.world_T_sensor, ANCHORS[0] @ planar(0.5 * i, 0, 0), atol=0.1)


def test_without_odometry_a_robot_moves_on_for_as_long_as_the_stamps_say(site: Site) -> None:
    tracker = Tracker(site)
    for i, stamp_s in ((0, 0), (2, 1)):  # a metre in a second
        tracker.localize(seen(0, 0.5 * i), None, stamp_s * 10**9)
    fix = tracker.localize(seen(0, 4.0), None, 4 * 10**9)  # 3 m on after three, farther than it could be found without
    assert (fix.verdict, tracker.mode) == ("accepted", "tracking")
    np.testing.assert_allclose(fix.world_T_sensor, ANCHORS[0] @ planar(4, 0, 0), atol=0.1)


def test_a_robot_that_is_carried_off_is_lost_and_found(site: Site) -> None:
    tracker = Tracker(site)
    for i in range(3):
        tracker.localize(seen(0, 0.5 * i), planar(0.5, 0, 0))
    modes, verdicts = [], []
    for i in range(PATIENCE + 5):
        fix = tracker.localize(seen(2, 0.5 * i), planar(0.5, 0, 0))
        modes.append(tracker.mode)
        verdicts.append((fix.verdict, bool(np.linalg.norm(fix.world_T_sensor[:2, 3] - ANCHORS[2, :2, 3]) < 10)))
    assert modes[:2] == ["tracking", "tracking"]
    assert "lost" in modes
    assert verdicts[-1] == ("accepted", True)
    assert ("accepted", False) not in verdicts


def test_the_command_follows_a_path(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pipeline.cli import main

    for i in range(3):
        np.save(tmp_path / f"{i}.npy", seen(1, 0.5 * i).astype(np.float32))
    main(["localize", str(packed(tmp_path)), str(tmp_path), "--track"])
    assert "3 scans: 3 accepted" in capsys.readouterr().err
