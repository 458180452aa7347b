"""Slides: where a street repeats itself a pose does not lead, and where it does not it does."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import schemas, store
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.slides import slide
from pipeline.posing.targets import GRAIN_M, Targets
from pipeline.posing.walls import Walls
from tests.posing.scene import planar, seen_from

EVERY_M = 18.0
"""From one house to the next."""


def house(x_m: float, side: float, drive: int) -> np.ndarray:
    """Three walls of a house, 10 m long, 8 m off the middle of a street along x."""
    rng = np.random.default_rng(int(1000 + 10 * x_m + side + 5000 * drive))
    front = np.column_stack([rng.uniform(0, 10, 700) + x_m, np.full(700, 8.0 * side), rng.uniform(0, 7, 700)])
    sides = [
        np.column_stack([np.full(300, x_m + at), side * rng.uniform(8, 14, 300), rng.uniform(0, 7, 300)]) for at in (0.0, 10.0)
    ]
    return np.concatenate([front, *sides])


def street(last_m: float, own: bool, drive: int) -> np.ndarray:
    """Houses on both sides every 18 m; with a kiosk of its `own` at 30 m; each drive meets other points of them."""
    rng = np.random.default_rng(drive)
    ground = np.column_stack([rng.uniform(-40, last_m + 40, 9000), rng.uniform(-20, 20, 9000), rng.normal(0, 0.02, 9000)])
    parts = [ground, *(house(x_m, side, drive) for x_m in np.arange(-36, last_m + 36, EVERY_M) for side in (-1, 1))]
    if own:
        parts.append(np.column_stack([rng.uniform(27, 33, 900), rng.uniform(5, 6, 900), rng.uniform(0, 5, 900)]))
    return np.concatenate(parts)


def driven(folder: Path, own: bool) -> tuple[np.ndarray, Targets]:
    """The street as a later drive meets it, and the map of one along it, a submap every 4 m."""
    points_m = street(120.0, own, 0)
    anchors = np.array([planar(x_m, 0, 0) for x_m in np.arange(0, 120, 4)])
    clouds = [visible(points_m, anchor) for anchor in anchors]
    with store.write(folder / "day.zarr", schemas.MAPS, grain_m=GRAIN_M, voxel_m=0.5, range_m=80.0, single=True) as out:
        out.put("points", np.rint(np.concatenate(clouds) / GRAIN_M).astype(np.int64))
        out.put("offsets", np.cumsum([0, *map(len, clouds)]))
        out.put("world_T_anchor", anchors)
    return street(120.0, own, 1), Targets.read(folder / "day.zarr")


def visible(points_m: np.ndarray, world_T_robot: np.ndarray) -> np.ndarray:
    near_m = seen_from(points_m, world_T_robot)
    return near_m[np.hypot(near_m[:, 0], near_m[:, 1]) < 25]


@pytest.fixture(scope="module", params=[False, True], ids=["of equal houses", "with a kiosk"])
def world(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[bool, np.ndarray, Targets]:
    return request.param, *driven(tmp_path_factory.mktemp("street"), request.param)


def test_a_pose_leads_by_what_only_its_own_place_has(world: tuple[bool, np.ndarray, Targets]) -> None:
    own, points_m, targets = world
    walls, at = Walls(), planar(30, 0.5, 2)
    found = slide(walls, targets, walls.middles(visible(points_m, at)), at, np.zeros(len(targets.world_T_anchor), bool))
    assert (found.lead > 0.05) is own
    slid = targets.world_T_anchor[found.row] @ found.target_T_query
    if not own:
        assert abs(abs(slid[0, 3] - 30) % EVERY_M) == pytest.approx(0, abs=1.5) or abs(
            abs(slid[0, 3] - 30) % EVERY_M - EVERY_M
        ) == pytest.approx(0, abs=1.5)


def test_on_a_street_of_equal_houses_no_pose_is_believed(world: tuple[bool, np.ndarray, Targets]) -> None:
    """The right pose and its copies share the chance; with a kiosk the right one has it."""
    own, points_m, targets = world
    found = Fixer().fix(visible(points_m, planar(30, 0.5, 2)), targets, Answers(np.array([[32.0, 0.0]]), np.array([0.0])))
    assert (found.chance > 0.9) is own
    if not own:
        assert len(found.elsewhere) >= 1
        assert found.chances[found.elsewhere[0]] > 0.5 * found.chance
    else:
        assert np.linalg.norm(found.hypotheses[0].world_T_query[:2, 3] - (30, 0.5)) < 0.3


def test_far_from_all_submaps_a_slide_tells_nothing(world: tuple[bool, np.ndarray, Targets]) -> None:
    _, points_m, targets = world
    walls = Walls()
    middles, none = walls.middles(visible(points_m, planar(30, 0, 0))), np.zeros(len(targets.world_T_anchor), bool)
    assert slide(walls, targets, middles, planar(0, 500, 0), none).lead == 0.0
    assert slide(walls, targets, middles, planar(30, 0, 0), ~none).row == -1
