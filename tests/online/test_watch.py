"""`yearloc watch` records a drive for rerun, and as a bag for Foxglove."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.core.grid import Grid
from pipeline.formats.bag import CLOUD, POSE_COVARIANCE, TRANSFORMS, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.formats.pointcloud2 import decode
from pipeline.online import site_file
from pipeline.online.site import Site
from pipeline.online.watch import whole_map
from tests.commands import Command
from tests.online.made import GRID, scan
from tests.posing.scene import scene
from tests.readers.bags import cloud


@pytest.fixture(scope="module")
def drive(three_places: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The site, and a folder of three scans: one accepted, one from elsewhere, one without pose."""
    folder = tmp_path_factory.mktemp("drive")
    for number, points_m in enumerate((scan()[0], scene(7), np.ones((9, 3)))):
        np.save(folder / f"{number}.npy", points_m.astype(np.float32))
    return str(three_places), str(folder)


def test_a_recording_for_rerun_has_map_scans_and_verdicts(
    drive: tuple[str, str], tmp_path: Path, yearloc: Command
) -> None:
    _, reported = yearloc.run("watch", *drive, "--save", tmp_path / "day.rrd")
    assert "3 scans: 1 accepted, 0 near, 0 ambiguous, 1 rejected, 1 no pose" in reported
    data = (tmp_path / "day.rrd").read_bytes()
    assert data[:3] == b"RRF"
    for name in (b"world/map", b"world/robot/scan", b"probability/accepted_from", b"StateChange"):
        assert name in data


def test_a_recording_holds_its_panels_and_cameras_that_follow_the_robot(
    drive: tuple[str, str], tmp_path: Path, yearloc: Command
) -> None:
    assert "WARN" not in yearloc.run("watch", *drive, "--save", tmp_path / "day.rrd")[1]
    command = (Path(sys.executable).parent / "rerun", "rrd", "print", "-vvv", tmp_path / "day.rrd")
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert text.count("EyeControls3D:position") >= 3
    assert all(name in text for name in ("StateTimeline", "/world/robot", "/world/runner_up"))


def test_a_bag_for_foxglove_has_map_scans_and_fixes(drive: tuple[str, str], tmp_path: Path) -> None:
    main(["watch", *drive, "--save", str(tmp_path / "day.mcap")])
    bag = BagFile(tmp_path / "day.mcap")
    assert {name: (topic.kind, topic.count) for name, topic in bag.topics.items()} == {
        "/tf_static": (TRANSFORMS, 1),
        "/map": (CLOUD, 1),
        "/scan": (CLOUD, 2),
        "/fixes": (CLOUD, 2),
        "/fix": (POSE_COVARIANCE, 1),
    }
    fix = decode(bag.decode(bag.first("/fixes") or b"", CLOUD))
    origin_m = translation(bag)
    np.testing.assert_allclose(fix[0, :2] + origin_m[:2], scan()[1][:2, 3], atol=0.1)


def translation(bag: BagFile) -> np.ndarray:
    """Where the frame of the clouds lies in the map: x, y, z in metres."""
    (transform,) = bag.decode(bag.first("/tf_static") or b"", TRANSFORMS).transforms
    position = transform.transform.translation
    return np.array([position.x, position.y, position.z])


def test_points_as_far_out_as_utm_lie_where_the_poses_put_them(
    three_places: Path, tmp_path: Path
) -> None:
    """At 4,000,000 m float32 is exact to a quarter of a metre only."""
    away_m = np.array([500_000.0, 4_000_000.0, 0.0])
    parts = site_file.read(three_places)
    far = {name: dict(part) for name, part in (("model", parts.model), ("arrays", parts.arrays))}
    far["arrays"]["world_T_anchor"] = far["arrays"]["world_T_anchor"].copy()
    far["arrays"]["world_T_anchor"][:, :3, 3] += away_m
    far["model"] = {
        name: array + away_m[:2] if name.endswith("xy_m") else array
        for name, array in far["model"].items()
    }
    x_m = tuple(np.add(GRID.x_m, away_m[0]).tolist())
    y_m = tuple(np.add(GRID.y_m, away_m[1]).tolist())
    description = replace(parts.description, places=Grid(GRID.cell_m, x_m, y_m))
    site_file.write(tmp_path / "far.site", parts._replace(description=description, **far))
    np.save(tmp_path / "1.npy", scan()[0].astype(np.float32))
    words = [str(tmp_path / "far.site"), str(tmp_path / "1.npy")]
    main(["watch", *words, "--save", str(tmp_path / "day.mcap")])
    bag = BagFile(tmp_path / "day.mcap")
    origin_m = translation(bag)
    pose = bag.decode(bag.first("/fix") or b"", POSE_COVARIANCE).pose.pose.position
    np.testing.assert_allclose((pose.x, pose.y), (scan()[1][:3, 3] + away_m)[:2], atol=0.1)
    fix_m = decode(bag.decode(bag.first("/fixes") or b"", CLOUD))[0].astype(np.float64) + origin_m
    np.testing.assert_allclose(fix_m, (pose.x, pose.y, pose.z), atol=0.001)
    mapped_m = decode(bag.decode(bag.first("/map") or b"", CLOUD)).astype(np.float64) + origin_m
    np.testing.assert_allclose(mapped_m, whole_map(Site.open(tmp_path / "far.site")), atol=0.001)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--save", "day.txt"], "--save day.txt: expected FILE.rrd or FILE.mcap"),
        (["--save", "day.rrd", "--every", "0"], "--every 0: expected at least 1"),
        (
            ["--save", "day.rrd", "--target-precision", "1", "--strict"],
            "target_precision=1: this site has no threshold for it; it has thresholds for 0.95, 0.99",
        ),
    ],
)
def test_wrong_options_are_refused_in_a_line(
    drive: tuple[str, str], yearloc: Command, words: list[str], says: str
) -> None:
    assert says in yearloc.refused("watch", *drive, *words)


def test_a_drive_that_is_still_being_recorded_is_watched(
    drive: tuple[str, str], tmp_path: Path, yearloc: Command
) -> None:
    with BagWriter(tmp_path / "live", "mcap") as bag:
        cloud(bag, 10**9, "base_link", scan()[0])
    (recording,) = (tmp_path / "live").glob("*.mcap")
    live = ("--follow", "--track", "--idle", 0.3, "--save", tmp_path / "day.rrd")
    assert "1 scan: 1 accepted" in yearloc.run("watch", drive[0], recording, *live)[1]
