"""What campus_nclt adds to the campus of the demo: relief on walls, denser bare trees, and a ground
truth that is not exact.
"""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np

from pipeline.formats.nclt import GROUND_TRUTH
from tests.worlds.helpers import FLAT, record, refused
from worlds.driving.drive import SEGWAY, drive, reference_poses
from worlds.driving.lidar import hdl32
from worlds.driving.scene import build_scene
from worlds.layout.shapes import BOX, CROWN, CYLINDER, Kind, records
from worlds.simulation import Simulation


def wall_m(relief_m: float, seed: int) -> np.ndarray:
    """The points (n, 3) that a scan sees on a wall whose face is at y = 8 m."""
    wall = records(
        BOX,
        y_m=9.0,
        half_width_m=1.0,
        half_length_m=30.0,
        cos_yaw=1.0,
        top_m=9.0,
        reflectance=0.4,
        kind=Kind.BUILDING,
    )
    scene = build_scene(wall, np.zeros(0, CYLINDER), np.zeros(0, CROWN), FLAT, relief_m)
    lidar = replace(hdl32(720), range_sd_m=0.0, drop_out=0.0)
    returns = lidar.scan(scene, np.zeros(0, CYLINDER), np.eye(4)[None], np.uint64(seed))
    near = (returns.kind == Kind.BUILDING) & (np.abs(returns.points_m[:, 0]) < 4.0)
    return np.asarray(returns.points_m[near])


def test_parts_of_a_wall_stand_out_of_it_and_are_the_same_in_every_scan():
    flat = wall_m(0.0, 1)
    first = wall_m(0.3, 1)
    second = wall_m(0.3, 2)
    assert np.abs(flat[:, 1] - 8.0).max() < 1e-6
    assert 0.2 < np.abs(first[:, 1] - 8.0).max() < 0.3 + 1e-6
    # Uniform between −0.3 and 0.3 m along the ray: deviation 0.3 / √3 = 0.17 m, a little less
    # across the wall.
    assert 0.12 < first[:, 1].std() < 0.18
    assert np.array_equal(first, second)
    assert len(np.unique((first[:, 1] / np.linalg.norm(first, axis=1)).round(6))) < len(first)


def test_the_reference_path_wanders_smoothly_about_the_driven_one():
    driven = drive(
        0, date(2012, 1, 15), np.array([[0.0, 0.0], [4200.0, 0.0]]), FLAT, 4000.0, 2.0, SEGWAY
    )
    reference = reference_poses(driven, np.random.default_rng(0), 0.1)
    off_m = (reference.world_T_body - driven.world_T_body)[:, :3, 3]
    assert np.allclose(off_m[:, :2].std(0), 0.1, atol=0.04)
    assert (off_m[:, 2] == 0).all()
    assert np.abs(off_m).max() <= 0.3 + 1e-9
    assert np.abs(np.diff(off_m, axis=0)).max() < 0.01  # between two knots 0.13 m apart
    assert np.array_equal(
        reference_poses(driven, np.random.default_rng(0), 0.0).world_T_body, driven.world_T_body
    )


def test_a_ground_truth_that_is_off_leaves_scans_and_odometry_as_they_are(
    small: Simulation, tmp_path: Path
):
    for name, world in (("exact", small), ("off", replace(small, ground_truth_sd_m=0.5))):
        record(world, "2012-02-04", tmp_path / name)
    exact, off = (tmp_path / name / "2012-02-04" for name in ("exact", "off"))
    same = [
        path.relative_to(exact)
        for path in exact.rglob("*")
        if path.is_file() and not path.name.startswith("groundtruth")
    ]
    assert len(same) == 27
    assert all((exact / path).read_bytes() == (off / path).read_bytes() for path in same)
    rows = [
        np.loadtxt(path / GROUND_TRUTH.format(sequence="2012-02-04"), delimiter=",")[5:, 1:4]
        for path in (exact, off)
    ]
    assert 0.05 < np.hypot(*(rows[1] - rows[0])[:, :2].T).max() < 2.2


def test_less_than_nothing_is_refused(small: Simulation):
    for setting in ("relief_m", "twigs_per_m", "ground_truth_sd_m"):
        with refused(setting):
            replace(small, **{setting: -0.1})
