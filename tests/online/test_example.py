"""The site and scans that come with the package answer as the README shows, which runs them too."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import distance_and_turn
from pipeline.online.example import FOLDER, SITE, scans
from pipeline.online.site import Site
from tests.commands import Command

ROOT = Path(__file__).parents[2]
LARGEST_BYTES = 5e6
PYTHON = re.compile(r"```python\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def site() -> Site:
    return Site.open(SITE)


def test_the_example_is_small_and_says_that_it_is_simulated(site: Site) -> None:
    assert sum(path.stat().st_size for path in FOLDER.iterdir() if path.is_file()) < LARGEST_BYTES
    assert site.description.simulated
    assert 0.99 in site.target_precisions


def test_the_learned_place_is_accepted_and_right_and_the_one_outside_the_map_is_not_accepted(
    site: Site,
) -> None:
    learned, changed, elsewhere = scans()
    fix = site.localize(learned.points_m())
    away_m, turn_deg = distance_and_turn(fix.world_T_sensor[None], learned.world_T_scan[None])
    assert fix.verdict == "accepted"
    assert away_m[0] < 2.0
    assert turn_deg[0] < 5.0
    assert site.localize(elsewhere.points_m()).verdict in ("rejected", "no pose")
    fix = site.localize(changed.points_m())
    away_m, turn_deg = distance_and_turn(fix.world_T_sensor[None], changed.world_T_scan[None])
    assert fix.verdict != "accepted" or (away_m[0] < 2.0 and turn_deg[0] < 5.0)


def test_the_command_prints_verdict_pose_probability_and_error_of_each_scan(
    yearloc: Command,
) -> None:
    text, _ = yearloc.run("example")
    assert "simulated" in text.splitlines()[0]
    first, *others = text.split("\n\n")[1:]
    assert len(others) == 2
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = [line for line in text.splitlines() if line and not re.match(" +(pose|runner)", line)]
    assert len(shown) == 7
    assert all(line in readme for line in shown)
    assert re.search(r"verdict +accepted: ", first)
    pose = r"pose +x -?\d+\.\d\d m, y -?\d+\.\d\d m, heading -?\d+\.\d°"
    assert re.search(rf"{pose}; probability [01]\.\d{{3}}, 0\.\d\d m and 0\.\d° off", first)
    assert "verdict    rejected: " in others[1] or "verdict    no pose: " in others[1]


def test_readmes_python_runs_and_prints_an_accepted_pose(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (code,) = PYTHON.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len([line for line in code.splitlines() if line]) <= 10
    exec(code, {})
    assert re.search(r"\[\[ ?-?\d\.\d+", capsys.readouterr().out)


def test_the_scans_are_points_in_metres_with_the_ground_at_0() -> None:
    for scan in scans():
        points_m = scan.points_m()
        assert points_m.ndim == 2
        assert points_m.dtype == np.float32
        assert abs(np.median(points_m[np.abs(points_m[:, :2]).max(axis=1) < 5, 2])) < 0.2
