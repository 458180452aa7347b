"""Level sites: packed from a map or from sweeps, used in Python and by commands."""

import json
from collections import Counter
from copy import copy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.cli import main
from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.progress import Progress
from pipeline.formats.bag import CLOUD, BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.formats.pointcloud2 import decode
from pipeline.level.level_map import LevelMap
from pipeline.level.validation import Sweeps
from pipeline.level.verdict import OF_SWEEPS
from pipeline.online.description import describe
from pipeline.online.level_pack import CARMEN, pack_sweeps
from pipeline.online.level_site import LevelSite
from pipeline.online.site import NO_THRESHOLDS, Site
from pipeline.online.tracking import Tracker
from pipeline.report.figures.level_plan import Plan
from tests.commands import Command
from tests.level.hall import drive, map_of_hall, sweep
from tests.posing.scene import scene
from tests.readers.logs import flaser
from tests.views.made import artifacts


@pytest.fixture(scope="module")
def hall_yaml(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Nav2 map of the hall, by a drive through it."""
    return map_of_hall(tmp_path_factory.mktemp("hall"))


@pytest.fixture(scope="module")
def hall(hall_yaml: Path) -> Path:
    """The site of this map."""
    out = hall_yaml.with_name("hall.site")
    main(["pack", "--map", str(hall_yaml), "-o", str(out)])
    return out


def test_a_sweep_is_localised_in_the_site_of_a_map(hall: Path) -> None:
    site = Site.open(hall)
    assert isinstance(site, LevelSite)
    assert site.is_level
    place = (16.0, 6.0, 2.0)
    fix = site.localize(sweep(*place, noise=np.random.default_rng(1)), target_precision=0.95)
    assert fix.verdict == "accepted"
    assert np.linalg.norm(fix.world_T_sensor[:2, 3] - place[:2]) < 0.06
    assert fix.covariance.shape == (6, 6)
    assert (np.linalg.eigvalsh(fix.covariance) > 0).all()
    assert fix.accepted_at in site.target_precisions
    assert "level site hall" in describe(hall).text()


def test_the_same_map_makes_the_same_bytes(hall: Path, hall_yaml: Path, tmp_path: Path) -> None:
    main(["pack", "--map", str(hall_yaml), "-o", str(tmp_path / "again.site")])
    assert (tmp_path / "again.site").read_bytes() == hall.read_bytes()


def hall_log(folder: Path) -> Path:
    """A CARMEN log of another drive, whose odometry turns too far; each sweep has 180 ranges."""
    sweeps = drive(seed=9)
    odometry = [(*odom[:2, 3], np.arctan2(odom[1, 0], odom[0, 0])) for odom in sweeps.odom_T_sweep]
    lines = ["PARAM robot_front_laser_max 50.0 1 host 1\n"]
    for row, world in enumerate(sweeps.world_T_sweep[:25]):
        angles = np.arctan2(*np.asarray(sweeps.points(row)).T[::-1])
        ranges = np.full(180, 50.0)
        beams = np.rint((angles + np.pi / 2) / (np.pi / 179)).astype(int)
        ranges[beams] = np.linalg.norm(sweeps.points(row), axis=1)
        heading = np.arctan2(world[1, 0], world[0, 0])
        robot = f"{world[0, 3]} {world[1, 3]} {heading}"
        reading = " ".join(map(str, odometry[row]))
        # the reading before a sweep is odometry's, the one after it repeats the corrected pose
        lines.append(f"ODOM {reading} 1 0 0 {row} host {row}\n")
        lines.append(flaser(ranges.round(3).tolist(), robot, row + 1))
        lines.append(f"ODOM {reading} 1 0 0 {row} host {row}\n")
    path = folder / "hall.log"
    path.write_text("".join(lines))
    return path


@pytest.mark.parametrize("track", [[], ["--track"]])
def test_the_sweeps_of_a_log_are_gathered_and_localised(
    hall: Path, tmp_path: Path, yearloc: Command, track: list[str]
) -> None:
    log = hall_log(tmp_path)
    lines, summary = yearloc.run(
        "localize", hall, log, "--json", "--target-precision", 0.95, *track
    )
    rows = [json.loads(line) for line in lines.splitlines()]
    ground_truth = drive(seed=9).world_T_sweep
    accepted = [number for number, row in enumerate(rows) if row["verdict"] == "accepted"]
    assert len(rows) == 25
    assert len(accepted) >= 20
    for number in accepted:
        x_m, y_m = ground_truth[number][:2, 3]
        assert np.hypot(rows[number]["x"] - x_m, rows[number]["y"] - y_m) < 0.3
    assert "0 are over 1 m or 10° off" in summary


def test_a_drive_is_recorded_for_both_viewers_and_drawn_in_the_plan_of_the_building(
    hall: Path, tmp_path: Path, yearloc: Command
) -> None:
    log = hall_log(tmp_path)
    words = ("watch", hall, log, "--target-precision", 0.95, "--every", 5, "--save")
    yearloc.run(*words, tmp_path / "drive.rrd")
    assert b"world/map" in (tmp_path / "drive.rrd").read_bytes()
    yearloc.run(*words, tmp_path / "drive.mcap")
    bag = BagFile(tmp_path / "drive.mcap")
    (_, walls) = next(iter(bag.messages("/map")))
    assert len(decode(bag.decode(walls, CLOUD))) == len(Site.open(hall).walls_m)
    said, _ = yearloc.run(
        "picture", hall, log, "-o", tmp_path / "found.gif", "--target-precision", 0.95
    )
    assert "found.gif: hall: hall.log: 2" in said
    with Image.open(tmp_path / "found.gif") as picture:
        assert picture.n_frames == 25
        assert picture.width == 800


def test_walls_of_the_plan_lie_where_they_are_in_the_world(hall: Path) -> None:
    """The hall is 20 by 12 m; a cell is 5 cm."""
    site = Site.open(hall)
    assert isinstance(site, LevelSite)
    low_m, high_m = site.walls_m.min(axis=0), site.walls_m.max(axis=0)
    np.testing.assert_allclose(low_m, (0, 0, 0), atol=0.15)
    np.testing.assert_allclose(high_m, (20, 12, 0), atol=0.15)
    plan = Plan(site.level_map)
    corners_px = plan.at_px(np.array([[0.0, 0.0], [20.0, 12.0]]))
    assert corners_px[0, 0] < corners_px[1, 0]
    assert corners_px[0, 1] > corners_px[1, 1]  # y points up, rows of pixels down
    assert plan.px(20) == pytest.approx(corners_px[1, 0] - corners_px[0, 0])
    left_px, middle_px = plan.at_px(np.array([[0.02, 6.0], [16.0, 6.0]])).astype(int).tolist()
    assert plan.image.getpixel(tuple(left_px)) == (0x4A, 0x4A, 0x4A)
    assert plan.image.getpixel(tuple(middle_px)) == (255, 255, 255)


def test_the_plan_of_a_building_that_is_longer_in_y_is_turned(hall: Path) -> None:
    """Then the y axis of the map points to the right."""
    site = Site.open(hall)
    assert isinstance(site, LevelSite)
    occupancy = np.ascontiguousarray(np.rot90(site.level_map.occupancy, -1))  # row 0 lies below
    upright = Plan(LevelMap(occupancy, site.level_map.cell_m, (0.0, 0.0, 0.0)))
    assert upright.image.width == 800
    assert upright.image.height < 600
    right_px, above_px = upright.at_px(np.array([[11.0, 1.0], [1.0, 19.0]])).tolist()
    assert right_px[0] < above_px[0]


def test_a_picture_of_a_site_needs_a_level_one_and_a_log(
    hall: Path, three_places: Path, tmp_path: Path, yearloc: Command
) -> None:
    out = tmp_path / "found.gif"
    assert "a site of 3-D scans" in yearloc.refused("picture", three_places, "x", "-o", out)
    assert "expected a log or a bag" in yearloc.refused("picture", hall, "-o", out)


def test_the_laser_scans_of_a_bag_are_localised(
    hall: Path, tmp_path: Path, yearloc: Command
) -> None:
    hits = sweep(16.0, 6.0, 2.0, beams=181)
    with BagWriter(tmp_path / "drive.bag", "ros1") as bag:
        ranges_m = np.linalg.norm(hits, axis=1)
        bag.laser_scan(10**9, "laser", ranges_m, -np.pi / 2, np.pi / 180, 0.1, 30.0)
    line, _ = yearloc.run(
        "localize", hall, tmp_path / "drive.bag", "--json", "--target-precision", 0.95
    )
    row = json.loads(line)
    assert row["verdict"] == "accepted"
    assert np.hypot(row["x"] - 16, row["y"] - 6) < 0.1


def test_a_tracker_finds_a_robot_again_that_was_carried_without_odometry(hall: Path) -> None:
    site = Site.open(hall)
    assert isinstance(site, LevelSite)
    sweeps = drive(seed=4)
    tracker = Tracker(site, 0.95)
    for row in range(30):
        at = row if row < 15 else row + 20  # it is carried 20 sweeps farther, without odometry
        step = None if row in (0, 15) else sweeps.step(at)
        fix = tracker.localize(sweeps.points(at), step)
        true = sweeps.world_T_sweep[at, None]
        assert fix.verdict != "accepted" or OF_SWEEPS.right(fix.world_T_sensor[None], true)
    assert fix.verdict == "accepted"


def test_a_level_track_starts_only_from_a_fix_that_its_own_sweeps_accept(hall: Path) -> None:
    """The belief is no substitute, neither at the start nor until the robot has moved on by the
    5 m over which sweeps are gathered: they overlap until then."""
    site = Site.open(hall)
    assert isinstance(site, LevelSite)
    unsure = copy(site)
    unsure.target_precisions = dict.fromkeys(
        site.target_precisions, NO_THRESHOLDS
    )  # no sweeps alone are accepted
    sweeps = drive(seed=4)
    tracker = Tracker(unsure, 0.95)
    for row in range(6):
        fix = tracker.localize(sweeps.points(row), sweeps.step(row))
        assert (fix.verdict, fix.accepted_at) == ("rejected", None)
    assert fix.probability > 0.999
    tracker.site = site
    assert tracker.localize(sweeps.points(6), sweeps.step(6)).verdict == "accepted"
    tracker.site = unsure
    assert tracker.localize(sweeps.points(6), np.eye(4)).verdict == "rejected"
    tracker.site = site
    for row in range(7, 22):  # at row 21 it is 4.98 m from row 6
        assert tracker.localize(sweeps.points(row), sweeps.step(row)).verdict == "accepted"
    tracker.site = unsure
    assert tracker.localize(sweeps.points(22), sweeps.step(22)).verdict == "accepted"


def test_scans_and_commands_of_the_other_kind_of_site_are_refused_in_a_line(
    hall: Path, three_places: Path, tmp_path: Path, yearloc: Command
) -> None:
    with pytest.raises(InputError, match="a 3-D scan, its points lie over"):
        Site.open(hall).localize(scene(0))
    flat = np.column_stack([sweep(16.0, 6.0, 2.0), np.zeros(180)])
    with pytest.raises(InputError, match="a level sweep, all in one plane"):
        Site.open(three_places).localize(flat)
    with pytest.raises(InputError, match="expected numbers"):
        Site.open(hall).localize(np.zeros(7))
    assert "a level site, of a 2-D laser" in yearloc.refused("failures", hall, tmp_path)
    assert "--follow" in yearloc.refused("localize", hall, "x.mcap", "--follow")
    with pytest.raises(ArtifactError, match="a level site"):
        Site.open(hall, level=False)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("resolution: 0.05", "resolution: 0.001", "cells of 0.001 m: expected 0.01 to 0.5 m"),
        ("free_thresh: 0.196", "free_thresh: 0.0", "a map without free space"),
    ],
)
def test_a_map_that_cannot_be_packed_is_refused_in_a_line(
    hall_yaml: Path, tmp_path: Path, yearloc: Command, old: str, new: str, message: str
) -> None:
    text = hall_yaml.read_text()
    assert old in text
    (tmp_path / "hall.pgm").write_bytes(hall_yaml.with_suffix(".pgm").read_bytes())
    (tmp_path / "hall.yaml").write_text(text.replace(old, new))
    line = yearloc.refused("pack", "--map", tmp_path / "hall.yaml", "-o", tmp_path / "hall.site")
    assert message in line
    assert not (tmp_path / "hall.site").exists()


def mutated(points_m: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    """A sweep as a broken or wrongly mounted laser gives it."""
    turn = rng.uniform(np.deg2rad(30), np.deg2rad(180))
    cos, sin = np.cos(turn), np.sin(turn)
    if kind == "upside down":
        return np.asarray(points_m * [1, -1])
    if kind == "turned":
        return np.asarray(points_m @ np.array([[cos, sin], [-sin, cos]]))
    if kind == "twelve beams":
        return points_m[rng.choice(len(points_m), 12, replace=False)]
    if kind == "range_max":
        short = rng.random(len(points_m)) < rng.uniform(0.3, 0.9)
        far = points_m / np.linalg.norm(points_m, axis=1)[:, None] * 29.9
        return np.asarray(np.where(short[:, None], far, points_m))
    if kind == "nan":
        out = points_m.copy()
        out[rng.random(len(out)) < rng.uniform(0.5, 1.0)] = np.nan
        return out
    if kind == "scaled":
        return np.asarray(points_m * rng.choice([0.5, 0.7, 1.4, 2.0]))
    return rng.uniform(-10, 10, points_m.shape)  # noise


KINDS = ("upside down", "turned", "twelve beams", "range_max", "nan", "scaled", "noise")


def test_no_wrong_pose_of_a_mutated_sweep_is_accepted(hall: Path) -> None:
    site = Site.open(hall)
    rng = np.random.default_rng(0)
    accepted: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    for number in range(210):
        kind = KINDS[number % len(KINDS)]
        place = (rng.uniform(8, 19), rng.uniform(0.7, 5.3), rng.uniform(-np.pi, np.pi))
        points_m = mutated(sweep(*place, noise=rng), kind, rng)
        fix = site.localize(points_m)
        if fix.verdict == "accepted":
            accepted[kind] += 1
            # the position counts alone: a turned laser is localised in its own, turned frame
            wrong[kind] += bool(np.linalg.norm(fix.world_T_sensor[:2, 3] - place[:2]) > 1)
    assert accepted["nan"] >= 10
    assert accepted["turned"] >= 20
    for kind in ("twelve beams", "range_max", "scaled", "noise"):
        assert accepted[kind] == 0
    # a room that looks the same in a mirror does not tell that the laser is upside down
    assert wrong["upside down"] <= 2
    assert wrong.total() == wrong["upside down"]


OFFICE = (
    *((0, 0, 30, 0), (0, 2.5, 10, 2.5), (11, 2.5, 22, 2.5), (23, 2.5, 30, 2.5)),  # a corridor
    *((0, 0, 0, 9), (10, 2.5, 10, 7), (11, 2.5, 11, 9), (22, 2.5, 22, 8), (30, 0, 30, 9)),
    *((0, 9, 8, 7), (8, 7, 10, 7), (11, 9, 17, 7.5), (17, 7.5, 22, 8), (23, 2.5, 27, 6)),
)
"""The walls of another building, x and y of their ends in metres."""


def test_no_pose_of_another_building_s_sweeps_is_accepted(hall: Path) -> None:
    site = Site.open(hall)
    rng = np.random.default_rng(3)
    for _ in range(24):
        place = (rng.uniform(1, 29), rng.uniform(0.7, 1.8), rng.uniform(-np.pi, np.pi))
        fix = site.localize(sweep(*place, noise=rng, walls=OFFICE))
        assert fix.verdict != "accepted"


def test_a_training_day_of_level_sweeps_is_packed(tmp_path: Path, yearloc: Command) -> None:
    sweeps = drive(step_m=1.0)
    hits = [sweeps.points(row) for row in range(len(sweeps.world_T_sweep))]
    flat = [np.column_stack([points_m, np.full(len(points_m), 7.0)]) for points_m in hits]
    artifacts(tmp_path, flat, sweeps.world_T_sweep)
    scans = store.read(tmp_path / "scans.zarr", schemas.Scans)
    assert Sweeps.of(scans).is_level
    out = tmp_path / "hall.site"
    line = pack_sweeps("hall/10m/sci", out, scans, "monday", True, CARMEN, Progress())
    assert "level" in line
    site = Site.open(out)
    place = (16.0, 6.0, 2.0)
    fix = site.localize(sweep(*place), target_precision=None)
    assert np.linalg.norm(fix.world_T_sensor[:2, 3] - place[:2]) < 0.06
    assert "level site hall/10m/sci, simulated" in yearloc.run("inspect", out)[0]
