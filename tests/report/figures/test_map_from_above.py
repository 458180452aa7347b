"""Tests the picture of a 3-D map from above."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.core.progress import Progress
from pipeline.inspection.point_map import PointMap
from pipeline.report.figures import map_from_above
from tests.inspection.made_maps import house, write_pcd, yard


@pytest.fixture(scope="module")
def point_map(tmp_path_factory: pytest.TempPathFactory) -> PointMap:
    path = write_pcd(tmp_path_factory.mktemp("maps") / "yard.pcd", yard())
    return PointMap.read(path, Progress())


def test_walls_are_drawn_by_their_height_on_the_ground(point_map: PointMap) -> None:
    assert point_map.ground is not None
    raster = map_from_above.raster(point_map.tiled, point_map.ground)
    # the highest points of walls, at 5.75 m, are in the level from 5.4 to 5.8 m
    assert np.nanmax(raster.standing_m) == pytest.approx(5.8)
    # walls stand along y = 5, 15 … 55, and x = .5 and 59.5; cells are .4 m
    left_m, _, bottom_m, _ = raster.extent_m
    column = int((30.2 - left_m) / 0.4)
    rows = np.flatnonzero(np.isfinite(raster.standing_m[:, column]))
    y_m = bottom_m + (rows + 0.5) * 0.4
    np.testing.assert_allclose(y_m, [5, 15, 25, 35, 45, 55], atol=0.4)
    np.testing.assert_allclose(raster.ground_m[np.isfinite(raster.ground_m)], 0.0, atol=0.05)


def test_a_ceiling_does_not_hide_the_walls_below_it(tmp_path: Path) -> None:
    path = write_pcd(tmp_path / "house.pcd", house(1))
    built = PointMap.read(path, Progress())
    assert built.ground is not None
    standing_m = map_from_above.raster(built.tiled, built.ground).standing_m
    # six walls and two ends of 60 m in cells of .4 m, of 150 × 150 cells
    assert np.isfinite(standing_m).sum() == pytest.approx(8 * 150, rel=0.05)


def test_the_same_map_gives_the_same_picture(point_map: PointMap, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        map_from_above.write(point_map, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        colours = np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)
    assert len(colours) > 50
