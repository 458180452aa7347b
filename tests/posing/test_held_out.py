"""Held-out fixes: blocks of a training day are asked with and without their surroundings, and say when a fix is clear."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import schemas, store
from pipeline.errors import ConfigError, InputError
from pipeline.matching.ranking import Ranking, Rows
from pipeline.posing.fix import Fixer
from pipeline.posing.held_out import HeldOut
from pipeline.posing.targets import GRAIN_M
from pipeline.posing.verdict import Evidence
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from tests.posing.scene import planar, scene, seen_from

ANCHORS = np.array([planar(x_m, y_m, 0) for y_m in (0, 400) for x_m in (0, 2, 4, 6)])
"""Two scenes far apart, each driven through in steps of 2 m."""
VIEWS = Rows(np.zeros((8, 1)), np.arange(8), ANCHORS)
HELD_OUT = HeldOut(every_m=4.0, length_m=2.0, around_m=30.0)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "day.zarr"
    clouds = [seen_from(scene(seed), planar(x_m, 0, 0)) for seed in (0, 1) for x_m in (0, 2, 4, 6)]
    with store.write(path, schemas.MAPS, grain_m=GRAIN_M, voxel_m=0.5, range_m=80.0, single=True) as out:
        out.put("points", np.rint(np.concatenate(clouds) / GRAIN_M).astype(np.int64))
        out.put("offsets", np.cumsum([0, *map(len, clouds)]))
        out.put("world_T_anchor", ANCHORS)
    return path


def localizer(views: Rows, k: int) -> Ranking:
    """Answers each view where it is."""
    xy_m, n = views.world_T_anchor[:, None, :2, 3], len(views.stamps_ns)
    column = np.zeros((n, 1), np.float32)
    return Ranking(np.zeros((n, 1), np.int64), column, xy_m, column, column[:, 0], column, ("own",))


def asked(views: Rows, path: Path) -> tuple[Evidence, float]:
    return HELD_OUT.evidence(Fixer(), path, localizer, views, np.zeros(len(views.stamps_ns), np.int64), 1, Compute(), Progress())


def test_blocks_are_right_with_their_surroundings_and_wrong_without(path: Path) -> None:
    evidence, clear_m = asked(VIEWS, path)
    assert 0 < evidence.queries < 8
    assert evidence.right.tolist() == [True] * evidence.queries + [False] * evidence.queries
    assert evidence.features.shape == (2 * evidence.queries, 3)
    overlap, spread_m = evidence.features[:, 0], 10 ** evidence.features[:, 2]
    assert overlap[evidence.right].min() > overlap[~evidence.right].max()
    assert spread_m[evidence.right].max() < clear_m
    assert clear_m <= spread_m[~evidence.right].max()


def test_a_map_of_another_day_is_refused(path: Path) -> None:
    other = Rows(np.zeros((8, 1)), np.arange(8), ANCHORS[::-1])
    with pytest.raises(InputError, match=r"day\.zarr: a map of 8 submaps that are not the 8 of the training views"):
        asked(other, path)


def test_blocks_longer_than_their_distance_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"held_out\.length_m=5\.0: expected less than held_out\.every_m=4\.0"):
        HeldOut(every_m=4.0, length_m=5.0, around_m=20.0)
