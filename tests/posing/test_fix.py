"""Fixes: among candidate training submaps the right pose is found, and where there is too little to tell, none."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import schemas, store
from pipeline.errors import ArtifactError, ConfigError
from pipeline.frames import apart
from pipeline.posing.fix import Fix, Fixer, Hypothesis
from pipeline.posing.targets import GRAIN_M, Targets
from tests.posing.scene import planar, scene, seen_from

ANCHORS = [planar(0, 0, 0), planar(200, 0, 90), planar(400, 0, -30)]


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Targets:
    """Three places, each another scene."""
    path = tmp_path_factory.mktemp("map") / "day.zarr"
    clouds = [seen_from(scene(seed), planar(0, 0, 0)) for seed in range(3)]
    offsets = np.cumsum([0, *map(len, clouds)])
    with store.write(path, schemas.MAPS, grain_m=GRAIN_M, voxel_m=0.5, range_m=80.0, single=True) as out:
        out.put("points", np.rint(np.concatenate(clouds) / GRAIN_M).astype(np.int64))
        out.put("offsets", offsets)
        out.put("world_T_anchor", np.array(ANCHORS))
    return Targets(path)


@pytest.mark.parametrize(("row", "x_m", "y_m", "yaw_deg"), [(0, 2.0, -1.0, 130.0), (1, -3.0, 4.0, 0.0), (2, 0.0, 0.0, -60.0)])
def test_the_pose_is_found_among_candidates(targets: Targets, row: int, x_m: float, y_m: float, yaw_deg: float) -> None:
    anchor_T_query = planar(x_m, y_m, yaw_deg)
    found = Fixer().fix(seen_from(scene(row), anchor_T_query), targets, [2, 1, 0])
    best = found.hypotheses[0]
    away_m, turn_deg = apart(best.world_T_query[None], (ANCHORS[row] @ anchor_T_query)[None])
    assert best.row == row
    assert away_m[0] < 0.1
    assert turn_deg[0] < 0.3
    assert best.support > 0.8


def test_a_place_that_the_map_does_not_have_overlaps_little(targets: Targets) -> None:
    here, elsewhere = (Fixer().fix(seen_from(scene(seed), planar(1, 1, 20)), targets, [0, 1, 2]) for seed in (0, 7))
    assert elsewhere.hypotheses[0].support < 0.6 * here.hypotheses[0].support


@pytest.mark.parametrize(
    "points_m",
    [
        np.zeros((0, 3)),
        np.random.default_rng(0).uniform(-10, 10, (12, 3)),
        np.full((5000, 3), np.nan),
        np.column_stack([np.random.default_rng(0).uniform(-20, 20, (5000, 2)), np.zeros(5000)]),
    ],
    ids=["none", "12 points", "NaN", "one plane"],
)
def test_too_little_to_tell_is_no_pose(targets: Targets, points_m: np.ndarray) -> None:
    found = Fixer().fix(points_m, targets, [0, 1, 2])
    assert found.hypotheses == ()
    assert found.runner_up == 0.0


def test_without_candidates_there_is_no_pose(targets: Targets) -> None:
    assert Fixer().fix(scene(), targets, []) == Fix()


def test_millimetres_are_not_accepted(targets: Targets) -> None:
    assert all(one.overlap < 0.1 for one in Fixer().fix(scene() * 1000, targets, [0, 1, 2]).hypotheses)


def test_the_runner_up_stands_elsewhere() -> None:
    found = Fix.of(
        [
            Hypothesis(i, planar(x_m, 0, 0), overlap, overlap, 0.01)
            for i, (x_m, overlap) in enumerate([(0, 0.4), (1, 0.9), (9, 0.5)])
        ]
    )
    assert [one.overlap for one in found.hypotheses] == [0.9, 0.5, 0.4]
    assert found.overlap == 0.9
    assert found.runner_up == 0.5
    assert Fix.of(found.hypotheses[::2]).runner_up == 0.0


def test_the_nearest_rows_come_in_the_order_of_the_positions(targets: Targets) -> None:
    positions_m = np.array([[390.0, 5.0], [10.0, 0.0], [np.nan, 0.0], [380.0, 0.0], [180.0, 0.0]])
    assert targets.nearest(positions_m).tolist() == [2, 0, 1]
    assert targets.nearest(positions_m, np.array([False, False, True])).tolist() == [1, 0]


def test_settings_and_a_missing_map_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"fixer\.tries=0: expected at least 1"):
        Fixer(tries=0)
    with pytest.raises(ConfigError, match=r"fixer\.clear_support=2"):
        Fixer(clear_support=2)
    with pytest.raises(ArtifactError, match="no such artifact"):
        Targets(tmp_path / "none.zarr")
