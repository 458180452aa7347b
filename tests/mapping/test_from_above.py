"""The footprint of a drive and the points of its scans, seen from above."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import ArtifactError
from pipeline.mapping.from_above import CELL_M, MOST_CELLS, Drive, Footprint, along
from tests.posing.scene import planar
from tests.views.made import artifacts

POST_M = np.array([(4.1, 2.1, z) for z in (1.0, 2.0, 3.0)])
KERB_M = np.array([(4.1, -2.1, 0.2), (4.1, -2.1, 0.3)])


def drive(folder: Path, points: list[np.ndarray], world_T_scan: np.ndarray) -> Drive:
    """A drive that has these scans."""
    artifacts(folder, points, world_T_scan)
    return Drive.read(folder / "scans.zarr", folder / "submaps.zarr")


def test_a_footprint_holds_what_stands_and_was_met_more_than_once(tmp_path: Path) -> None:
    """Seen from (0, 0) the post stands at (4.1, 2.1); from (10, 0), turned left, at (7.9, 4.1):
    both thrice. A passer at (1, 1) is met once, the kerb is too low."""
    passer_m = np.array([(1.0, 1.0, 1.5)])
    poses = np.array([planar(0, 0, 0), planar(10, 0, 90)])
    clouds = [np.concatenate([POST_M, KERB_M, passer_m]), np.concatenate([POST_M, KERB_M])]
    footprint = Footprint.of(along([drive(tmp_path, clouds, poses)]))
    assert footprint is not None
    assert footprint.corner_m == pytest.approx((1.0, 1.0), abs=0.01)
    rows, columns = np.nonzero(footprint.occupied)
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == [
        (2, 6),  # 1.1 and 3.1 m from the corner
        (6, 13),  # 3.1 and 6.9 m
    ]


def test_without_points_there_is_no_footprint_and_without_scans_no_drive(tmp_path: Path) -> None:
    assert Footprint.of(np.zeros((0, 3))) is None
    with pytest.raises(ArtifactError):
        Drive.read(tmp_path / "scans.zarr", tmp_path / "submaps.zarr")


def test_a_scan_is_kept_as_cells_of_what_stands(tmp_path: Path) -> None:
    scan = np.concatenate([POST_M, KERB_M])
    # 4.1 m and 2.1 m in cells of half a metre
    assert drive(tmp_path, [scan], planar(0, 0, 0)[None]).cells(0).tolist() == [[8, 4]]


def test_all_points_of_a_laser_that_sweeps_one_plane_stand(tmp_path: Path) -> None:
    sweep_m = np.array([(4.0, 0.0, 0.3), (0.0, 6.0, 0.3)])
    assert sorted(drive(tmp_path, [sweep_m], planar(0, 0, 0)[None]).cells(0).tolist()) == [
        [0, 12],
        [8, 0],
    ]


def test_no_more_points_than_a_page_holds_are_kept_of_a_scan(tmp_path: Path) -> None:
    side = np.arange(-20.0, 20.0, 2 * CELL_M)
    east_m, north_m = np.meshgrid(side, side)
    low_m = np.stack([east_m.ravel(), north_m.ravel(), np.full(east_m.size, 1.0)], axis=1)
    scan = np.concatenate([low_m, low_m + np.array([0, 0, 3])])
    full = drive(tmp_path, [scan], planar(0, 0, 0)[None])
    cells = full.cells(0)
    assert len(cells) == MOST_CELLS
    assert (cells == full.cells(0)).all()
