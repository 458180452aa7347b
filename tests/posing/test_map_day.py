"""A map as the training day of a study: its scans, its targets and its verdict."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.mapping.anchored_map import AnchoredMap
from pipeline.mapping.gathering import scan_points
from pipeline.mapping.tiled_map import Thinning
from pipeline.matching.correlation import WallMap
from pipeline.matching.ranking import Rows
from pipeline.methods.bev_correlation import BevCorrelation
from pipeline.posing.cut_outs import CutOuts, read_targets
from pipeline.posing.map_day import (
    RANGE_M,
    drawn_walls,
    write_map,
    write_scans,
)
from pipeline.posing.map_verdict import WALLS_M, usual
from pipeline.posing.search import Answers, Fixer
from pipeline.views.walls import Walls
from tests.mapping.made_map import sloped
from tests.mapping.town import town as flat_town
from tests.readers.damage import one_line


@pytest.fixture(scope="module")
def town() -> AnchoredMap:
    thinning = Thinning(0.4)
    thinning.add(sloped())
    return AnchoredMap.of(thinning.tiled(), "town", None, Progress())


@pytest.fixture(scope="module")
def walls(town: AnchoredMap) -> WallMap:
    return drawn_walls(town, "town", Progress())


def test_the_scans_of_a_map_are_its_squares(tmp_path: Path, town: AnchoredMap) -> None:
    count = write_scans(tmp_path / "map.zarr", town, 0.005, Progress())
    scans = store.read(tmp_path / "map.zarr", schemas.Scans)
    assert count == len(town.tiled.points) == scans.offsets[-1]
    assert np.array_equal(scans.world_T_scan, town.world_T_anchor)
    assert np.isnan(scans.load("odom_T_scan")).all()
    assert scans.stamps_ns[:2].tolist() == [0, 1_000_000_000]
    row = len(town.world_T_anchor) // 2
    (_, points_m) = next(scan_points(scans, row, row + 1))
    assert len(points_m)
    assert np.abs(points_m - town.square_m(row)).max() <= 0.0025 + 1e-9  # half a unit


def test_on_level_ground_the_method_draws_the_walls_that_a_site_has() -> None:
    """On a slope a site draws walls in the map's frame, the method in those of the anchors."""
    thinning = Thinning(0.4)
    thinning.add(flat_town())
    level = AnchoredMap.of(thinning.tiled(), "town", None, Progress())
    of_site = drawn_walls(level, "town", Progress())
    view = Walls()
    anchors = level.world_T_anchor
    images = np.stack([view(level.square_m(row)) for row in range(len(anchors))])
    rows = Rows(images, np.arange(len(anchors)), anchors)
    model = BevCorrelation(of_map=True).learn(rows, np.arange(len(anchors)), Progress())
    cells, cells_of_site = (
        {tuple(cell) for cell in (np.argwhere(drawn.counts > 0) + drawn.corner_m).tolist()}
        for drawn in (WallMap.of_arrays(model, 1.0), of_site)
    )
    assert len(cells & cells_of_site) > 0.97 * len(cells | cells_of_site)
    assert model["validation/block"].size == 0


def test_targets_of_a_map_are_cut_outs_that_fix_a_scan_cut_from_it(
    tmp_path: Path, town: AnchoredMap, walls: WallMap
) -> None:
    write_map(tmp_path / "map.zarr", town, walls, 0.4, RANGE_M)
    targets = read_targets(tmp_path / "map.zarr")
    assert isinstance(targets, CutOuts)
    assert np.array_equal(targets.world_T_anchor, town.world_T_anchor)
    row = int(np.linalg.norm(town.world_T_anchor[:, :2, 3] - (80, 80), axis=1).argmin())
    scan_m = targets.points_m(row) + np.array([1.0, 0.5, 0.0])  # the robot is 1 m back, .5 m right
    away_m = np.hypot(scan_m[:, 0], scan_m[:, 1])
    answer = Answers(town.world_T_anchor[row : row + 1, :2, 3], np.zeros(1))
    learned, fixer = usual(Fixer())
    fix = fixer.fix(scan_m[away_m < 40], targets, answer)
    expected = town.world_T_anchor[row] @ np.array([-1.0, -0.5, 0.0, 1.0])
    assert np.abs(fix.poses[0][:3, 3] - expected[:3]).max() < 0.05
    assert fixer.walls.range_m == WALLS_M
    assert learned.verdict.validation_blocks == 0
    assert learned.verdict.reachable == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)


def test_a_map_without_walls_is_refused() -> None:
    points_m = flat_town()
    thinning = Thinning(0.4)
    thinning.add(points_m[points_m[:, 2] < 0.5])
    flat = AnchoredMap.of(thinning.tiled(), "meadow", None, Progress())
    with one_line(InputError, "meadow: nothing stands 1 m or more above its ground"):
        drawn_walls(flat, "meadow", Progress())
