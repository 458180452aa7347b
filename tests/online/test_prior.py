"""Priors in the three kinds of sites: a right one decides, a wrong one costs time alone."""

from copy import copy
from pathlib import Path

import numpy as np
import pytest

from pipeline.level.field import Field
from pipeline.level.level_map import LevelMap
from pipeline.level.search import APART_M, Window, search
from pipeline.online.level_pack import pack_map
from pipeline.online.level_site import LevelSite
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from pipeline.posing.prior import Prior
from tests.level.hall import field, map_of_hall, sweep
from tests.mapping.town import scan as scan_of_town
from tests.mapping.town import town
from tests.online.made import scan
from tests.posing.scene import planar, scene, seen_from

PLACE = (16.0, 6.0, 2.0)


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Site:
    folder = tmp_path_factory.mktemp("hall")
    pack_map(map_of_hall(folder), folder / "hall.site")
    return Site.open(folder / "hall.site")


@pytest.fixture(scope="module")
def town_site() -> Site:
    return Site.of_map(town(0, 200.0))


@pytest.fixture(scope="module")
def twins() -> Site:
    """The site of a map in which the same town stands twice, 500 m apart."""
    once = town(0, 120.0)
    return Site.of_map(np.concatenate([once, once + np.array([500.0, 0.0, 0.0])]))


def test_a_scan_is_localised_within_a_right_prior_and_its_search_tries_less(
    three_places: Path,
) -> None:
    site = Site.open(three_places)
    points_m, true_pose = scan()
    prior = Prior.at(true_pose[0, 3] + 3, true_pose[1, 3], sigma_m=5.0)
    fix = site.localize(points_m, 0.95, prior)
    assert fix.verdict == "accepted"
    np.testing.assert_allclose(fix.world_T_sensor, true_pose, atol=0.1)
    elsewhere_m = scene(7)  # fits badly everywhere
    within, anywhere = (
        np.linalg.norm(site.seek(elsewhere_m, each).poses[:, :2, 3] - prior.xy_m, axis=1)
        for each in (prior, None)
    )
    assert (within > 60).sum() <= 1  # the ranking's first answer, as a rival
    assert (anywhere > 60).sum() > 1


def test_a_wrong_prior_changes_no_answer(three_places: Path) -> None:
    """The robot is in the second place; the priors are in the first and the third, and nowhere."""
    site = Site.open(three_places)
    points_m, true_pose = scan()
    for x_m, y_m in [(0.0, 0.0), (400.0, 0.0), (-5000.0, 0.0)]:
        within = site.judge(site.seek(points_m, Prior.at(x_m, y_m)), 0.95)
        assert within.verdict != "accepted"
        fix = site.localize(points_m, 0.95, Prior.at(x_m, y_m))
        assert fix.verdict == "accepted"
        np.testing.assert_allclose(fix.world_T_sensor, true_pose, atol=0.1)
        assert site.localize(scene(7), 0.95, Prior.at(x_m, y_m)).verdict != "accepted"


def test_a_wrong_heading_finds_no_pose_within_the_prior(three_places: Path) -> None:
    site = Site.open(three_places)
    points_m, true_pose = scan()
    heading_deg = np.rad2deg(np.arctan2(true_pose[1, 0], true_pose[0, 0]))
    xy_m = true_pose[:2, 3]
    right = Prior.at(xy_m[0], xy_m[1], heading_deg + 8, 3.0, 5.0)
    wrong = Prior.at(xy_m[0], xy_m[1], heading_deg + 180, 3.0, 5.0)
    assert site.judge(site.seek(points_m, right), 0.95).verdict == "accepted"
    assert site.judge(site.seek(points_m, wrong), 0.95).verdict != "accepted"


def test_of_two_equal_towns_a_prior_chooses_the_right_one(twins: Site) -> None:
    pose = planar(60.0, 60.0, 30.0)
    points_m = scan_of_town(town(0, 120.0), pose)
    for offset_m in (0.0, 500.0):
        fix = twins.localize(points_m, 0.95, Prior.at(62.0 + offset_m, 59.0, sigma_m=3.0))
        assert fix.verdict == "accepted"
        np.testing.assert_allclose(fix.world_T_sensor[:2, 3], (60.0 + offset_m, 60.0), atol=0.1)


def test_in_a_3d_map_a_wrong_prior_costs_time_alone(town_site: Site) -> None:
    pose = planar(60.0, 60.0, 30.0)
    points_m = scan_of_town(town(0, 200.0), pose)
    wrong = Prior.at(140.0, 140.0, sigma_m=3.0)
    ranking = town_site.rank(points_m, wrong)
    away_m = np.linalg.norm(ranking.xy_m[0] - wrong.xy_m, axis=1)
    assert np.nanmax(away_m) < wrong.reach_m + 20
    assert town_site.judge(town_site.seek(points_m, wrong), 0.95).verdict != "accepted"
    fix = town_site.localize(points_m, 0.95, wrong)
    assert fix.verdict == "accepted"
    np.testing.assert_allclose(fix.world_T_sensor[:2, 3], (60.0, 60.0), atol=0.1)


def test_a_sweep_is_localised_within_a_prior(hall: Site) -> None:
    hits_m = sweep(*PLACE, noise=np.random.default_rng(1))
    for heading_deg in (None, np.rad2deg(PLACE[2]) - 10):
        prior = Prior.at(15.0, 6.5, heading_deg, 1.0, 10.0)
        fix = hall.judge_query(hall.single(hits_m), hall.seek(hall.single(hits_m), prior), 0.95)
        assert fix.verdict == "accepted"
        assert np.linalg.norm(fix.world_T_sensor[:2, 3] - PLACE[:2]) < 0.1


def test_a_wrong_prior_of_a_sweep_costs_time_alone(hall: Site) -> None:
    query = hall.single(sweep(*PLACE, noise=np.random.default_rng(1)))
    for x_m, y_m in [(3.0, 3.0), (10.0, 9.0), (500.0, 0.0)]:
        wrong = Prior.at(x_m, y_m, sigma_m=1.0)
        assert hall.judge_query(query, hall.seek(query, wrong), 0.95).verdict != "accepted"
        fix = hall.find(query, 0.95, wrong)
        assert fix.verdict == "accepted"
        assert np.linalg.norm(fix.world_T_sensor[:2, 3] - PLACE[:2]) < 0.1


def test_of_two_equal_halls_a_prior_chooses_the_right_one(hall: Site) -> None:
    assert isinstance(hall, LevelSite)
    one = hall.level_map
    unknown = np.full((len(one.occupancy), round(5 / one.cell_m)), -1, np.int8)
    both = np.hstack([one.occupancy, unknown, one.occupancy])
    twins = copy(hall)
    twins.field = Field.of(LevelMap(both, one.cell_m, one.origin))
    offset_m = (one.occupancy.shape[1] + unknown.shape[1]) * one.cell_m
    hits_m = sweep(*PLACE, noise=np.random.default_rng(1))
    assert twins.localize(hits_m, 0.95).verdict != "accepted"
    for x_m in (PLACE[0], PLACE[0] + offset_m):
        fix = twins.localize(hits_m, 0.95, Prior.at(x_m + 0.5, PLACE[1], sigma_m=1.0))
        assert fix.verdict == "accepted"
        assert np.linalg.norm(fix.world_T_sensor[:2, 3] - (x_m, PLACE[1])) < 0.1


def test_a_window_finds_what_a_search_of_the_whole_map_finds_there() -> None:
    points_m = sweep(*PLACE)
    whole = search(field(), points_m, keep=1)
    x_m, y_m, heading_rad = whole.poses[0]
    for heading in (None, heading_rad + 0.1 - 2 * np.pi):
        within = search(field(), points_m, 1, window=Window(x_m + 1, y_m - 1, 1.5, heading, 0.3))
        turn_rad = (within.poses[0, 2] - heading_rad + np.pi) % (2 * np.pi) - np.pi
        np.testing.assert_allclose(within.poses[0, :2], (x_m, y_m))
        assert abs(turn_rad) < 1e-9
        assert within.scores[0] == whole.scores[0]
    beside = search(field(), points_m, 6, 0.0, window=Window(x_m + 4, y_m, 1.5, None, 0.0))
    assert len(beside.poses)
    assert (np.abs(beside.poses[:, 0] - x_m - 4) <= 1.5 + field().cell_m).all()
    assert (np.abs(beside.poses[:, 0] - x_m) > APART_M).all()
    for turned_rad in (np.pi, 2.0):
        away = Window(x_m, y_m, 1.5, heading_rad + turned_rad, 0.3)
        assert search(field(), points_m, 1, window=away).scores[0] < whole.scores[0]


def test_a_tracker_starts_again_at_a_prior(three_places: Path) -> None:
    """The prior is of the next scan alone, and what was tracked is forgotten."""
    tracker = Tracker(Site.open(three_places), 0.95)
    assert tracker.localize(scan(1)[0]).verdict == "accepted"
    points_m, true_pose = scan(2)
    tracker.restart(Prior.at(true_pose[0, 3], true_pose[1, 3], sigma_m=3.0))
    assert tracker.is_lost
    fix = tracker.localize(points_m)
    assert fix.verdict == "accepted"
    np.testing.assert_allclose(fix.world_T_sensor, true_pose, atol=0.1)
    tracker.restart()
    assert tracker.localize(scan(1)[0]).verdict == "accepted"
    assert tracker.localize(seen_from(scene(1), planar(-2, 4, 40))).verdict == "accepted"
