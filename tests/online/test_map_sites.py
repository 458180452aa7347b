"""The site of a made 3-D map is calibrated by a drive, and updated by one, from the command line."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.formats import pcd
from pipeline.lifelong.calibration import confirmed
from pipeline.online import site_file
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.map_pack import MapOptions, pack_map
from pipeline.online.site import Site
from pipeline.posing.cut_outs import CutOuts
from tests.commands import Command
from tests.mapping.town import scan, town
from tests.posing.scene import planar

MAP_M = town(0, 200.0)
POSES = [planar(58 + 6 * step, 58, 3 * step) for step in range(5)]
HOUSE_M = (72.3, 67.9)
"""The middle of a house beside the way, 12 m long."""


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    (folder / "town.pcd").write_bytes(pcd.encode(MAP_M))
    pack_map([folder / "town.pcd"], folder / "town.site", MapOptions(), Progress())
    return folder / "town.site"


def around(points_m: NDArray[np.float64], at_m: tuple[float, float]) -> NDArray[np.float64]:
    """The distance (n,) of points (n, 3) from a position, seen from above."""
    return np.hypot(points_m[:, 0] - at_m[0], points_m[:, 1] - at_m[1])


def drive(folder: Path, map_m: NDArray[np.float64] = MAP_M) -> tuple[str, str]:
    """A folder of scans in a map, and its reference poses, one row a scan."""
    folder.mkdir()
    for number, pose in enumerate(POSES):
        (folder / f"{number:03d}.pcd").write_bytes(pcd.encode(scan(map_m, pose)))
    rows = [" ".join(map(str, pose[:3].ravel())) for pose in POSES]
    poses = folder.with_suffix(".txt")
    poses.write_text("\n".join(rows) + "\n")
    return str(folder), str(poses)


def test_a_drive_calibrates_a_map_and_what_it_cannot_teach_stays_usual(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    log, poses = drive(tmp_path / "monday")
    out = tmp_path / "calibrated.site"
    said, _ = yearloc.run("calibrate", packed, log, "--poses", poses, "-o", out)
    assert "5 of 5 scans with a reference pose have a right fix; 5 validation blocks" in said
    assert "learned: none; by the usual probabilities: 0.9, 0.95, 0.97, 0.98, 0.985, 0.99" in said
    description = site_file.read(out).description
    assert description.verdict.validation_blocks == 5
    assert description.provenance.calibrated_on == "monday"
    assert description.verdict.usual == (0.9, 0.95, 0.97, 0.98, 0.985, 0.99)
    assert "not calibrated on this map" in Site.open(out).title


def test_a_drive_without_poses_and_odometry_is_refused_and_the_site_stays(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    log, _ = drive(tmp_path / "monday")
    before = packed.read_bytes()
    error = yearloc.refused("calibrate", packed, log)
    assert "neither reference poses nor odometry" in error
    assert packed.read_bytes() == before


def test_rows_of_poses_that_are_not_one_a_scan_are_refused(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    log, poses = drive(tmp_path / "monday")
    Path(poses).write_text("\n".join(Path(poses).read_text().splitlines()[:4]) + "\n")
    assert "4 rows of poses for 5 scans" in yearloc.refused(
        "calibrate", packed, log, "--poses", poses
    )


def test_a_wall_that_is_gone_is_removed_from_the_map_and_a_new_one_added(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    """A house is gone, and a wall of 6 m stands on the other side of the way."""
    x_m, z_m = np.meshgrid(np.arange(72, 78, 0.2), np.arange(0, 4, 0.2))
    wall_m = np.column_stack([x_m.ravel(), np.full(x_m.size, 50.0), z_m.ravel()])
    is_house = (around(MAP_M, HOUSE_M) < 9) & (MAP_M[:, 2] > 0.3)
    log, poses = drive(tmp_path / "tuesday", np.concatenate([MAP_M[~is_house], wall_m]))
    out = tmp_path / "updated.site"
    said, _ = yearloc.run("update", packed, log, "--poses", poses, "-o", out)
    assert "5 of 5 scans with reference poses; walls on" in said
    assert "its verdict is not calibrated on this map" in said
    before, after = Site.open(packed).targets, Site.open(out).targets
    assert isinstance(before, CutOuts)
    assert isinstance(after, CutOuts)

    houses, walls = (
        [
            int((around(targets.above_ground_m(1.0), at_m) < radius_m).sum())
            for targets in (before, after)
        ]
        for at_m, radius_m in ((HOUSE_M, 8), ((75.0, 50.0), 3))
    )
    assert houses[1] < 0.5 * houses[0]
    assert walls[0] == 0
    assert walls[1] > 20
    assert "then tuesday (5 views" in yearloc.run("inspect", out)[0]


def test_a_drive_that_agrees_with_the_map_teaches_nothing(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    log, poses = drive(tmp_path / "monday")
    assert "the map has all that they show" in yearloc.refused(
        "update", packed, log, "--poses", poses
    )


def test_reference_poses_that_no_scan_agrees_with_calibrate_nothing(
    packed: Path, tmp_path: Path, yearloc: Command
) -> None:
    """The poses are 40 m off, and stamped poses say nothing of scans without stamps."""
    log, poses = drive(tmp_path / "monday")
    moved = [planar(40, 0, 0) @ pose for pose in POSES]
    Path(poses).write_text("\n".join(" ".join(map(str, pose[:3].ravel())) for pose in moved) + "\n")
    before = packed.read_bytes()
    assert "0 of 5 scans have a right fix by their reference poses" in yearloc.refused(
        "calibrate", packed, log, "--poses", poses
    )
    Path(poses).write_text("".join(f"{row} {row} 0 0 0 0 0 1\n" for row in range(5)))
    assert "none of 5 scans has a stamp" in yearloc.refused(
        "calibrate", packed, log, "--poses", poses
    )
    assert packed.read_bytes() == before


def test_odometry_and_the_other_scans_confirm_a_pose() -> None:
    """Odometry is in another frame. The scans at both ends have no scan behind or before them."""
    site = Site.of_map(MAP_M)
    odom_T_world = planar(5, -3, 40)
    scans = [
        Scan("", None, partial(scan, MAP_M, pose), odom_T_world @ pose, NO_POSE) for pose in POSES
    ]
    poses = confirmed(site, scans, 0.95)
    is_confirmed = np.isfinite(poses).all(axis=(1, 2))
    assert not is_confirmed[[0, -1]].any()
    assert is_confirmed.any()
    np.testing.assert_allclose(
        poses[is_confirmed][:, :2, 3], np.array(POSES)[is_confirmed][:, :2, 3], atol=0.5
    )
