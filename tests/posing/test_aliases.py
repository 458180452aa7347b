"""Tests of aliases: a pose has a margin over them only where the street does not repeat itself."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import yaw
from pipeline.posing.aliases import FAR_M, WIDEST_MARGIN, aliases, aliases_in_map
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.walls import Walls
from pipeline.posing.whole_map import Slid, WholeMap
from tests.artifacts import write_map
from tests.posing.scene import planar, seen_from

EVERY_M = 18.0
"""Distance from one house to the next."""


def upright(
    rng: np.random.Generator, corners: list[tuple[float, float]], n: int = 700
) -> np.ndarray:
    """Points (n, 3) on walls 7 m high from each corner to the next."""
    parts = []
    for (x0, y0), (x1, y1) in pairwise(corners):
        share = rng.uniform(0, 1, n)
        parts.append(
            np.column_stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0), rng.uniform(0, 7, n)])
        )
    return np.concatenate(parts)


def houses(rng: np.random.Generator) -> np.ndarray:
    """Houses on both sides of a street along x, one every 18 m, 10 m long."""
    return np.concatenate(
        [
            upright(
                rng,
                [(x_m, 14 * side), (x_m, 8 * side), (x_m + 10, 8 * side), (x_m + 10, 14 * side)],
            )
            for x_m in np.arange(-36, 156, EVERY_M)
            for side in (-1, 1)
        ]
    )


def colonnade(rng: np.random.Generator) -> np.ndarray:
    """Pillars of 1 m on both sides, one every 6 m, before long walls."""
    pillars = [
        upright(
            rng, [(x_m, y_m), (x_m + 1, y_m), (x_m + 1, y_m + 1), (x_m, y_m + 1), (x_m, y_m)], 150
        )
        for x_m in np.arange(-36, 156, 6.0)
        for y_m in (-7.0, 6.0)
    ]
    return np.concatenate(
        [*pillars, *(upright(rng, [(-36, y_m), (156, y_m)], 9000) for y_m in (-12.0, 12.0))]
    )


def trees(rng: np.random.Generator) -> np.ndarray:
    """Trunks with crowns on both sides, one every 9 m."""
    parts = []
    for x_m in np.arange(-36, 156, 9.0):
        for y_m in (-7.0, 7.0):
            around = rng.normal(0, 1, (300, 3))
            crown = around / np.linalg.norm(around, axis=1, keepdims=True) * 1.8 + (x_m, y_m, 4.5)
            turn = rng.uniform(0, 2 * np.pi, 150)
            trunk = np.column_stack(
                [x_m + 0.3 * np.cos(turn), y_m + 0.3 * np.sin(turn), rng.uniform(0, 3, 150)]
            )
            parts += [crown, trunk]
    return np.concatenate(parts)


def crossing(rng: np.random.Generator) -> np.ndarray:
    """A crossing at 32 m with four equal corners, which only drives beyond it could tell apart."""
    corner = [(8.0, 30.0), (8.0, 8.0), (30.0, 8.0)]
    turned = [
        [(x, y) for x, y in corner],
        [(-y, x) for x, y in corner],
        [(-x, -y) for x, y in corner],
        [(y, -x) for x, y in corner],
    ]
    return np.concatenate([upright(rng, one, 2000) for one in turned]) + np.array([32.0, 0.0, 0.0])


STREETS = {
    "equal houses": houses,
    "a colonnade": colonnade,
    "rows of trees": trees,
    "a crossing of equal corners": crossing,
}


def street(kind: str, has_kiosk: bool, drive: int) -> np.ndarray:
    """Points (n, 3) of a street of some kind and its ground, with a kiosk at 30 m or without.

    Each drive samples other points of them.
    """
    rng = np.random.default_rng(drive)
    ground = np.column_stack(
        [rng.uniform(-40, 160, 9000), rng.uniform(-20, 20, 9000), rng.normal(0, 0.02, 9000)]
    )
    parts = [ground, STREETS[kind](rng)]
    if has_kiosk:
        parts += [
            upright(rng, [(26, 4), (33, 4), (33, 5.5), (26, 5.5), (26, 4)], 600),
            upright(rng, [(38, -4), (38, -6), (41, -6)]),
        ]
    return np.concatenate(parts)


def driven(folder: Path, kind: str, has_kiosk: bool) -> tuple[np.ndarray, Targets]:
    """The points of a street on a later drive, and the map of an earlier one: a submap every 4
    m."""
    points_m = street(kind, has_kiosk, 0)
    anchors = np.array([planar(x_m, 0, 0) for x_m in np.arange(0, 120, 4)])
    if kind.startswith("a crossing"):
        anchors = anchors[6:11]  # 24 to 40 m
    clouds = [visible(points_m, anchor) for anchor in anchors]
    write_map(folder / "day.zarr", clouds, anchors)
    return street(kind, has_kiosk, 1), Targets.read(folder / "day.zarr")


def visible(points_m: np.ndarray, world_T_robot: np.ndarray) -> np.ndarray:
    near_m = seen_from(points_m, world_T_robot)
    return near_m[np.hypot(near_m[:, 0], near_m[:, 1]) < 25]


Scene = tuple[str, bool, np.ndarray, Targets]
AT = planar(32, 0.5, 2)


@pytest.fixture(
    scope="module",
    params=[(kind, has_kiosk) for kind in STREETS for has_kiosk in (False, True)],
    ids=lambda one: f"{one[0]}, {'with' if one[1] else 'without'} a kiosk",
)
def world(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    kind, has_kiosk = request.param
    return kind, has_kiosk, *driven(tmp_path_factory.mktemp("street"), kind, has_kiosk)


def test_a_pose_has_a_margin_only_if_its_place_is_distinctive(world: Scene) -> None:
    _, has_kiosk, points_m, targets = world
    walls = Walls()
    result = aliases(
        walls,
        targets,
        walls.middles(walls.of(visible(points_m, AT))),
        AT,
        np.zeros(len(targets.world_T_anchor), bool),
    )
    assert (result.margin > 0.05) is has_kiosk


def test_where_a_street_repeats_itself_no_pose_is_probable(world: Scene) -> None:
    """The right pose and its aliases share the probability; with a kiosk the right pose has it."""
    _, has_kiosk, points_m, targets = world
    result = Fixer().fix(
        visible(points_m, AT), targets, Answers(np.array([[32.0, 0.0]]), np.array([0.0]))
    )
    assert (result.probability > 0.9) is has_kiosk
    if has_kiosk:
        assert np.linalg.norm(result.hypotheses[0].world_T_query[:2, 3] - AT[:2, 3]) < 0.3


def test_far_from_all_submaps_there_are_no_aliases_and_no_margin(
    world: tuple[bool, np.ndarray, Targets],
) -> None:
    *_, points_m, targets = world
    walls = Walls()
    middles = walls.middles(walls.of(visible(points_m, planar(30, 0, 0))))
    none = np.zeros(len(targets.world_T_anchor), bool)
    assert aliases(walls, targets, middles, planar(0, 500, 0), none).margin == 0.0
    assert aliases(walls, targets, middles, planar(30, 0, 0), ~none).ranked == ()


def test_the_aliases_of_a_pose_among_equal_houses_are_whole_houses_away(tmp_path: Path) -> None:
    """Houses stand every 18 m."""
    points_m, targets = driven(tmp_path, "equal houses", has_kiosk=False)
    walls = Walls()
    middles = walls.middles(walls.of(visible(points_m, AT)))
    result = aliases(walls, targets, middles, AT, np.zeros(len(targets.world_T_anchor), bool))
    margins = [alias.margin for alias in result.ranked]
    assert margins == sorted(margins)
    assert margins[0] == result.margin
    anchors = [targets.world_T_anchor[alias.row] for alias in result.ranked]
    pairs = zip(anchors, result.ranked, strict=True)
    away_m = [(anchor @ alias.target_T_query)[0, 3] - AT[0, 3] for anchor, alias in pairs]
    assert len(away_m) == 3
    assert min(abs(abs(away) - EVERY_M) for away in away_m) < 1.5


def test_a_search_that_begins_a_house_too_early_ends_at_the_right_one(tmp_path: Path) -> None:
    """The ranking is a house off, where the walls fit; the kiosk shows which alias is right."""
    points_m, targets = driven(tmp_path, "equal houses", has_kiosk=True)
    answers = Answers(np.array([[32.0 - EVERY_M, 0.0]]), np.array([0.0]))
    result = Fixer(rounds=(1,)).fix(visible(points_m, AT), targets, answers)
    assert np.linalg.norm(result.hypotheses[0].world_T_query[:2, 3] - AT[:2, 3]) < 0.3
    wrong = Fixer().track(visible(points_m, AT), targets, planar(32.0 - EVERY_M, 0, 0))
    assert np.linalg.norm(wrong.hypotheses[0].world_T_query[:2, 3] - AT[:2, 3]) > 10


def test_an_alias_that_becomes_the_likeliest_is_compared_with_its_own_aliases(
    tmp_path: Path,
) -> None:
    """The ranking is two houses off. Beyond the right pose lies an alias of that pose which is too
    far from the ranking's pose to be an alias of it."""
    points_m, targets = driven(tmp_path, "equal houses", has_kiosk=True)
    first_m = AT[0, 3] + 2 * EVERY_M
    answers = Answers(np.array([[first_m, 0.0]]), np.array([0.0]))
    result = Fixer(rounds=(1,)).fix(visible(points_m, AT), targets, answers)
    x_m = [hypothesis.world_T_query[0, 3] for hypothesis in result.hypotheses]
    assert abs(x_m[0] - AT[0, 3]) < 0.3
    assert first_m - min(x_m) > FAR_M


def test_at_a_crossing_of_equal_corners_the_best_alias_is_turned(tmp_path: Path) -> None:
    """The four corners look the same to a robot that turns by 90°, and nothing along the street
    fits as well."""
    points_m, targets = driven(tmp_path, "a crossing of equal corners", has_kiosk=False)
    walls = Walls()
    at = planar(32, 0, 0)
    result = aliases(
        walls,
        targets,
        walls.middles(walls.of(visible(points_m, at))),
        at,
        np.zeros(len(targets.world_T_anchor), bool),
    )
    turn_deg = np.rad2deg(yaw(result.ranked[0].target_T_query[None])[0])
    assert abs(turn_deg) > 80
    assert abs(result.margin) < 0.05


def test_an_alias_at_the_other_end_of_the_map_takes_the_margin_of_a_pose(tmp_path: Path) -> None:
    """Two equal yards stand 200 m apart. Nothing within 40 m looks like either of them."""
    yard = [(-9.0, -6.0), (-9.0, 11.0), (4.0, 11.0), (4.0, 6.0), (13.0, 6.0), (13.0, -6.0)]
    rng = np.random.default_rng(0)

    def made(has_second: bool) -> np.ndarray:
        one = upright(rng, yard, 2000)
        ground = np.column_stack(
            [rng.uniform(-30, 230, 20000), rng.uniform(-20, 20, 20000), np.zeros(20000)]
        )
        second = [one + np.array([200.0, 0.0, 0.0])] if has_second else []
        return np.concatenate([ground, one, *second])

    def judged(has_second: bool) -> tuple[float, list[float]]:
        """The margin of the pose in the first yard, and where along x its aliases lie."""
        points_m = made(has_second)
        anchors = np.array([planar(x_m, 0, 0) for x_m in (*range(0, 12, 4), *range(196, 212, 4))])
        clouds = [visible(points_m, anchor) for anchor in anchors]
        path = tmp_path / f"{has_second}.zarr"
        write_map(path, clouds, anchors)
        targets = Targets.read(path)
        none = np.zeros(len(anchors), bool)
        query_m = visible(points_m, planar(2, 0, 0))
        walls, whole_map = Walls(), WholeMap()
        near = aliases(walls, targets, walls.middles(walls.of(query_m)), planar(2, 0, 0), none)
        slid = Slid(whole_map, targets.wall_map(whole_map, none), whole_map.scan(query_m, True))
        result = aliases_in_map(slid, targets, planar(2, 0, 0), none, near, least_margin=0.1)
        beyond = result.ranked[len(near.ranked) :]
        return result.margin, [
            float((targets.world_T_anchor[alias.row] @ alias.target_T_query)[0, 3])
            for alias in beyond
        ]

    margin, _ = judged(has_second=False)
    assert margin > 0.5 * WIDEST_MARGIN
    margin, x_m = judged(has_second=True)
    assert abs(margin) < 0.05
    assert abs(x_m[0] - 202) < 2
