"""A robot with a level laser in one of two equal rooms: nothing tells which, and no pose is
accepted."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pipeline.formats import nav2_map
from pipeline.formats.nav2_map import GridMap
from pipeline.level.level_map import Drawing, LevelMap
from pipeline.level.verdict import OF_SWEEPS
from pipeline.online.level_pack import pack_map
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from tests.level.hall import pose, sweep

CELL_M = 0.05
APART_M = 12.0
"""From one room to the other along x: whole cells of the map."""
ROOM = (
    *((0, 0, 9, 0), (9, 0, 9, 6), (9, 6, 0, 6), (0, 6, 0, 0)),
    *((3, 0, 3, 2), (3, 2, 4, 2), (6, 6, 6, 4.5), (0, 4, 1.5, 4), (7.5, 1, 8, 1.5)),
)
"""x, y of the start and the end of each wall of a room, and of what stands in it."""
CORNERS = ((1.2, 1.0), (1.8, 3.0), (5.0, 3.2), (7.5, 3.0))
"""The way through the room."""


def places() -> list[tuple[float, float, float]]:
    """x, y and heading every quarter of a metre of the way."""
    found = []
    for (x0, y0), (x1, y1) in pairwise(CORNERS):
        steps = int(np.hypot(x1 - x0, y1 - y0) / 0.25)
        for share in np.arange(steps) / steps:
            heading = float(np.arctan2(y1 - y0, x1 - x0))
            found.append((x0 + share * (x1 - x0), y0 + share * (y1 - y0), heading))
    return found


def one_room() -> LevelMap:
    """The map of one room, from the sweeps along the way."""
    hits_m = [sweep(*place, walls=ROOM) for place in places()]
    poses = np.array([pose(*place) for place in places()])
    return Drawing.of(hits_m, poses, cell_m=CELL_M).level_map()


@pytest.fixture(scope="module", params=["cells around", "no cells around"])
def twins(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Site:
    """The site of both rooms: the same cells twice, with cells between them that nobody saw.

    A map may end at its outermost walls: then one room has its left wall at the edge of the map,
    the other its right one.
    """
    room = one_room()
    first, *_, last = np.flatnonzero(room.walls.any(axis=0))
    occupancy = room.occupancy[:, first : last + 1]
    rows, cols = occupancy.shape
    unseen = np.full((rows, round(APART_M / CELL_M) - cols), -1, np.int8)
    both = np.concatenate([occupancy, unseen, occupancy], axis=1)
    x_m, y_m, yaw_rad = room.origin
    x_m += CELL_M * int(first)
    if request.param == "cells around":
        both = np.concatenate([unseen, both, unseen], axis=1)
        x_m -= CELL_M * unseen.shape[1]
    folder = tmp_path_factory.mktemp("twins")
    nav2_map.write(folder / "twins.yaml", GridMap(both, CELL_M, (x_m, y_m, yaw_rad)))
    pack_map(folder / "twins.yaml", folder / "twins.site")
    return Site.open(folder / "twins.site")


def test_in_one_of_two_equal_rooms_no_pose_is_accepted_but_both_are_named(twins: Site) -> None:
    """The way is 7 m long, so sweeps that are gathered over 5 m are two views of their own."""
    tracker = Tracker(twins, 0.95)
    noise = np.random.default_rng(3)
    before = None
    for place in places():
        true = pose(*place)
        step = None if before is None else np.linalg.inv(before) @ true
        before = true
        fix = tracker.localize(sweep(*place, noise=noise, walls=ROOM), step)
        assert fix.verdict == "ambiguous"
        assert tracker.is_lost
        named = np.array([fix.world_T_sensor, fix.runners_up[0].world_T_sensor])
        for room_m in (0.0, APART_M):
            in_room = np.broadcast_to(pose(room_m, 0, 0) @ true, named.shape)
            assert OF_SWEEPS.right(named, in_room).sum() == 1


def test_in_one_room_alone_the_same_sweep_is_accepted(tmp_path: Path) -> None:
    """So it is the second room that keeps the first from being accepted."""
    room = one_room()
    nav2_map.write(tmp_path / "room.yaml", GridMap(room.occupancy, CELL_M, room.origin))
    pack_map(tmp_path / "room.yaml", tmp_path / "room.site")
    fix = Site.open(tmp_path / "room.site").localize(sweep(*places()[-1], walls=ROOM), 0.95)
    assert fix.verdict == "accepted"
    assert OF_SWEEPS.right(fix.world_T_sensor[None], pose(*places()[-1])[None])[0]
