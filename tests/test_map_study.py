"""A study that learns a 3-D map instead of a drive, from its files to the evaluation of poses."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.frames import distance_and_turn
from pipeline.evaluation.evaluations import Evaluations
from pipeline.matching.rejection import ACCEPT_NOTHING
from tests.clone import Clone
from tests.mapping.made_map import ELSEWHERE, drive

OF_TOWN = [0, 1, 3, 4, 5]
MODEL = "artifacts/{}/nova/10m/bev_correlation/car.zarr"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The artifacts of a map and six scans, the third of which is of another town."""
    root = drive(tmp_path_factory.mktemp("drives"))
    clone = Clone(tmp_path_factory.mktemp("map_study"))
    clone.run("yearloc", "use", "nova", f"map={root / 'town.pcd'}", f"root={root}", "latency=no")
    clone.run("dvc", "repro", "dag/evaluate/dvc.yaml")
    return clone.folder


def test_the_search_finds_each_scan_of_the_town_in_the_map(built: Path) -> None:
    ranking = store.read(built / MODEL.format("localize"), schemas.Rankings)
    submaps = store.read(built / "artifacts/submaps/nova/car.zarr", schemas.Submaps)
    away_m = np.linalg.norm(ranking.xy_m[:, 0] - submaps.world_T_anchor[:, :2, 3], axis=1)
    assert (away_m[OF_TOWN] < 2).all()
    assert away_m[ELSEWHERE] > 2


def test_nothing_is_learned_from_a_map_on_when_to_reject(built: Path) -> None:
    ranking = store.read(built / MODEL.format("localize"), schemas.Rankings)
    fixes = store.read(built / MODEL.format("poses"), schemas.Fixes)
    assert ranking.thresholds == (ACCEPT_NOTHING,)
    assert fixes.validation_blocks == 0
    assert fixes.pose_thresholds == (0.05, 0.05, 0.01, 0.01, 0.01, 0.01, *2 * [ACCEPT_NOTHING])


def test_poses_are_right_and_that_of_another_town_is_not_accepted(built: Path) -> None:
    fixes = store.read(built / MODEL.format("poses"), schemas.Fixes)
    submaps = store.read(built / "artifacts/submaps/nova/car.zarr", schemas.Submaps)
    away_m, turn_deg = distance_and_turn(fixes.world_T_query, submaps.world_T_anchor)
    assert (away_m[OF_TOWN] < 0.2).all()
    assert (turn_deg[OF_TOWN] < 1).all()
    is_accepted = fixes.novelty[:, 0] < fixes.reject_from()
    assert is_accepted[OF_TOWN].sum() >= 3
    assert not is_accepted[ELSEWHERE]


def test_the_evaluation_says_that_poses_are_not_calibrated(built: Path) -> None:
    path = built / "artifacts/evaluate/nova/10m/bev_correlation-pose/car.zarr"
    evaluation = store.read(path, Evaluations).case()
    assert evaluation.unsuited["caveat_uncalibrated"] == 1
    assert np.isnan(evaluation.validation_precision).all()
