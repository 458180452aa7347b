"""Following a robot: what is believed of it, and how fixes are accepted by it."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.online.site import Site
from pipeline.online.tracking import PATIENCE, Tracker
from pipeline.paths.belief import Belief
from tests.online.made import ANCHORS, packed
from tests.posing.scene import planar, scene, seen_from

LINE_M = np.column_stack([np.arange(0, 300, 5.0), np.zeros(60)])


def whole(belief: Belief) -> float:
    return belief.unseen + float(belief.chances.sum())


def test_at_first_a_chance_stays_what_it_is() -> None:
    for chance in (0.05, 0.5, 0.99):
        belief = Belief(LINE_M)
        assert belief.see(planar(100, 0, 0), chance) == pytest.approx(chance, abs=0.001)
        assert whole(belief) == pytest.approx(1)


def test_fixes_that_agree_with_the_path_raise_the_chance_and_those_that_do_not_lower_it() -> None:
    agreed, jumped = Belief(LINE_M), Belief(LINE_M)
    first = agreed.see(planar(100, 0, 0), 0.8)
    jumped.see(planar(100, 0, 0), 0.8)
    for belief in (agreed, jumped):
        belief.move(planar(4, 0, 0))
        assert whole(belief) == pytest.approx(1)
    assert agreed.see(planar(104, 0, 0), 0.8) > first + 0.05
    assert jumped.see(planar(200, 0, 0), 0.8) < 0.5


def test_a_tracked_pose_is_believed_by_its_own_chance_alone() -> None:
    better, worse = Belief(LINE_M), Belief(LINE_M)
    before, _ = (belief.see(planar(100, 0, 0), 0.9) for belief in (better, worse))
    assert better.see(planar(100, 0, 0), 0.95, tracked=True) > before
    assert worse.see(planar(100, 0, 0), 0.3, tracked=True) < before - 0.3


@pytest.mark.parametrize(("step", "to"), [(planar(8, 0, 0), planar(58, 0, 0)), (planar(0, 0, 90), planar(50, 0, 90))])
def test_belief_moves_and_turns_with_the_robot(step: np.ndarray, to: np.ndarray) -> None:
    belief = Belief(LINE_M)
    belief.see(planar(50, 0, 0), 0.99)
    belief.move(step)
    heading, row, column = np.unravel_index(belief.chances.argmax(), belief.chances.shape)
    turns, rows, columns = belief._near(to)
    assert heading in turns
    assert rows.start <= row < rows.stop
    assert columns.start <= column < columns.stop


def test_what_leaves_the_map_is_somewhere_unseen_and_a_carried_robot_is_found_again() -> None:
    belief = Belief(LINE_M)
    belief.see(planar(5, 0, 180), 0.999)
    for _ in range(10):
        belief.move(planar(4, 0, 0))  # 40 m beyond the end
    assert belief.unseen > 0.7
    assert whole(belief) == pytest.approx(1)
    assert belief.see(planar(250, 0, 0), 0.99) > 0.2
    belief.move(planar(4, 0, 0))
    assert belief.see(planar(254, 0, 0), 0.99) > 0.9
    assert belief.see(planar(0, 500, 0), 0.99) == 0  # off the map


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
