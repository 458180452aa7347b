"""A recorded 3-D map, the campus of UT Dallas, and scans of another car four months later."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.frames import distance_and_turn
from pipeline.core.progress import Progress
from pipeline.mapping.tiled_map import Thinning
from pipeline.online.inputs import points_of_file
from pipeline.online.map_pack import VOXEL_M, MapOptions, pack_map
from pipeline.online.site import Fix, Site
from pipeline.opening.map_files import MapFiles

GROUPS = [range(12), range(12, 24), range(24, 36), range(36, 48)]
"""Scans that follow each other, of which the map's points around are taken away together."""


class Drive(NamedTuple):
    """The scans of the drive, with ground at z = 0, and where they were taken."""

    scans_m: list[NDArray[np.float64]]
    world_T_scan: NDArray[np.float64]
    """(48, 4, 4) poses that a registration found, checked along the path."""
    is_sure: NDArray[np.bool_]
    """(48,) whether the registration was sure: 45 of 48."""


@pytest.fixture(scope="module")
def nova(real: Path) -> Path:
    if not (real / "nova").is_dir():
        pytest.skip(f"no recorded map is at {real / 'nova'}")
    return real / "nova"


@pytest.fixture(scope="module")
def drive(nova: Path) -> Drive:
    rows = np.loadtxt(nova / "truth.csv", delimiter=",", skiprows=1)
    world_T_scan = np.tile(np.eye(4), (len(rows), 1, 1))
    world_T_scan[:, :3] = rows[:, 3:].reshape(-1, 3, 4)
    scans_m = [points_of_file(path) for path in sorted((nova / "scans").glob("*.pcd"))]
    return Drive(scans_m, world_T_scan, rows[:, 1] == 1)


@pytest.fixture(scope="module")
def site(nova: Path, tmp_path_factory: pytest.TempPathFactory) -> Site:
    out = tmp_path_factory.mktemp("nova") / "nova.site"
    said = "\n".join(pack_map([nova / "map"], out, MapOptions(), Progress()))
    assert "ground: cut off, 4." in said
    assert out.stat().st_size < 12e6  # 9.0 MB measured
    return Site.open(out)


def counts(
    drive: Drive, rows: NDArray[np.int64], fixes: list[Fix]
) -> tuple[int, dict[float, int], dict[float, int]]:
    """How many fixes are right, how many right ones are accepted at each target precision, and how
    many wrong ones."""
    poses = np.array([fix.world_T_sensor for fix in fixes])
    away_m, turn_deg = distance_and_turn(poses, drive.world_T_scan[rows])
    is_right = (away_m < 2) & (turn_deg < 5)
    accepted_at = np.array([fix.accepted_at or 0.0 for fix in fixes])
    right = {at: int((is_right & (accepted_at >= at)).sum()) for at in (0.95, 0.99)}
    wrong = {at: int((~is_right & (accepted_at >= at)).sum()) for at in (0.95, 0.99)}
    return int(is_right.sum()), right, wrong


def test_the_first_place_is_right_for_nearly_all_scans(site: Site, drive: Drive) -> None:
    rows = np.flatnonzero(drive.is_sure)
    rankings = [site.rank(site.single(drive.scans_m[row])) for row in rows]
    first_m = np.array([ranking.xy_m[0, 0] for ranking in rankings])
    away_m = np.linalg.norm(first_m - drive.world_T_scan[rows, :2, 3], axis=1)
    assert (away_m < 15).sum() >= 44  # measured 45 of 45


def test_every_third_scan_is_localised_and_no_wrong_pose_accepted(site: Site, drive: Drive) -> None:
    rows = np.flatnonzero(drive.is_sure)[::3]
    fixes = [site.localize(drive.scans_m[row]) for row in rows]
    right, accepted, wrong = counts(drive, rows, fixes)
    assert right >= 13  # of 15
    assert accepted[0.95] >= 7
    assert wrong == {0.95: 0, 0.99: 0}


@pytest.mark.slow
def test_all_scans_are_localised_and_no_wrong_pose_accepted(site: Site, drive: Drive) -> None:
    rows = np.flatnonzero(drive.is_sure)
    fixes = [site.localize(drive.scans_m[row]) for row in rows]
    right, accepted, wrong = counts(drive, rows, fixes)
    assert right >= 41  # measured 43 of 45
    assert accepted[0.95] >= 24  # measured 28
    assert accepted[0.99] >= 15  # measured 20
    assert wrong == {0.95: 0, 0.99: 0}


@pytest.mark.parametrize(
    "rows",
    [
        range(20, 23),
        *(pytest.param(group, marks=pytest.mark.slow) for group in GROUPS),
    ],
    ids=lambda rows: f"{rows[0]} to {rows[-1]}",
)
def test_scans_that_were_taken_off_the_map_are_not_accepted(
    nova: Path, drive: Drive, rows: range
) -> None:
    thinning = Thinning(VOXEL_M)
    positions_m = drive.world_T_scan[list(rows), :2, 3]
    for points_m in MapFiles.of([nova / "map"]).chunks(Progress()):
        offsets_m = points_m[:, None, :2] - positions_m
        is_far = (np.hypot(offsets_m[..., 0], offsets_m[..., 1]) > 100).all(axis=1)
        thinning.add(points_m[is_far])
    rest = Site.of_map(np.concatenate(list(thinning.tiled().tiles_m())))
    fixes = [rest.localize(drive.scans_m[row], 0.95) for row in rows]
    assert [fix.accepted_at for fix in fixes] == [None] * len(rows)
    assert "near" not in [fix.verdict for fix in fixes]
