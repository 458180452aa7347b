"""The push-broom car of the town: its logs, read back by the RobotCar reader."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.formats.robotcar import decode_sweep
from pipeline.readers.log import Log
from pipeline.readers.robotcar import RobotCar
from tests.worlds.helpers import contents, off_walls_m, record
from worlds.layout.shapes import Kind
from worlds.simulation import Simulation
from worlds.writers.robotcar import ORIGIN_M

TRAINING = "2014-07-14-14-49-50"
TEST = "2014-11-25-09-18-32"
SEQUENCES = {TRAINING: {"unseen": 0.0, "reversed": 0.0}, TEST: {"unseen": 0.1, "reversed": 0.0}}
CAMERA_M = 1.9411
"""Height of the stereo camera above the ground."""


@pytest.fixture(scope="module")
def town() -> Simulation:
    """Two sequences of 400 m, with a sweep of 181 rays every 0.4 m."""
    return Simulation(
        1,
        3,
        400.0,
        0.4,
        181,
        SEQUENCES,
        events_per_km_of_route=40.0,
        robot="push_broom_car",
        logs="robotcar",
    )


@pytest.fixture(scope="module")
def logs(town: Simulation, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folders of the logs and of the ground truth of the test sequence."""
    root = tmp_path_factory.mktemp("logs")
    ground_truth = tmp_path_factory.mktemp("ground_truth")
    record(town, TEST, root, ground_truth)
    return root, ground_truth


@pytest.fixture(scope="module")
def log(logs: tuple[Path, Path]) -> Log:
    """The test sequence as the reader gives it."""
    return RobotCar(extrinsics="{sequence}/extrinsics").open(logs[0], TEST)


def test_a_sequence_is_whole_in_its_own_folder(logs: tuple[Path, Path], log: Log):
    folder = logs[0] / TEST
    assert sorted(path.name for path in folder.iterdir()) == [
        "extrinsics",
        "gps",
        "lms_front",
        "lms_front.timestamps",
        "vo",
    ]
    sweeps = sorted(path.stem for path in (folder / "lms_front").iterdir())
    assert [
        line.split() for line in (folder / "lms_front.timestamps").read_text().splitlines()
    ] == [[stem, "1"] for stem in sweeps]
    # 25 November 2014, 9:18:32 UTC, and 2 s until the first sweep
    assert sweeps[0] == "1416907114000000"
    assert log.stamps_ns.tolist() == [int(stem) * 1000 for stem in sweeps]
    assert log.skipped == {}


def test_a_sweep_lies_in_the_plane_about_straight_down(logs: tuple[Path, Path]):
    seen = [
        decode_sweep(path.read_bytes()) for path in sorted((logs[0] / TEST / "lms_front").iterdir())
    ]
    x, y, reflectance = np.concatenate(seen).T
    bearing = np.rad2deg(np.arctan2(y, x))
    # 181 rays over 270° are 1.5° apart.
    assert np.abs(bearing).max() <= 135.0 + 1e-6
    assert np.abs(bearing / 1.5 - np.rint(bearing / 1.5)).max() < 1e-6
    below = np.abs(bearing) < 5
    # 0.9 m up, tilted forward by 6.5°: 0.906 m, less or more on rough ground.
    assert np.median(x[below]) == pytest.approx(0.906, abs=0.03)
    assert np.hypot(x, y).max() < 50.2
    assert reflectance.min() >= 0
    assert 1 < np.median(reflectance) < 255


def test_the_ins_puts_every_wall_point_on_a_wall(
    town: Simulation, logs: tuple[Path, Path], log: Log
):
    walls_m = []
    for row in np.flatnonzero(np.isfinite(log.world_T_scan).all((1, 2))):
        kinds = np.load(logs[1] / TEST / "kinds" / f"{log.stamps_ns[row] // 1000}.npy")
        points_m = log.points(int(row))[kinds == Kind.BUILDING]
        walls_m.append(
            points_m @ log.world_T_scan[row, :3, :3].T + log.world_T_scan[row, :3, 3] - ORIGIN_M
        )
    walls_m = np.concatenate(walls_m)
    assert len(walls_m) > 500
    off_m = off_walls_m(town, TEST, walls_m)
    # Range noise has an sd of 3 cm and never helps: 5 sds; rows 20 ms apart add some centimetres of
    # interpolation far away.
    assert np.percentile(off_m, 99) < 0.1
    assert off_m.max() < 0.3


def test_the_ground_lies_below_the_stereo_camera(log: Log):
    points_m = np.concatenate([log.points(row) for row in range(0, len(log.stamps_ns), 10)])
    near = np.abs(points_m[:, 1]) < 2
    assert np.median(points_m[near, 2]) == pytest.approx(-CAMERA_M, abs=0.03)


def test_the_place_is_unknown_in_outages_and_only_there(
    town: Simulation, logs: tuple[Path, Path], log: Log
):
    header, *rows = [
        line.split(",") for line in (logs[0] / TEST / "gps" / "ins.csv").read_text().splitlines()
    ]
    status, north = (
        np.array([row[header.index(name)] for row in rows]) for name in ("ins_status", "northing")
    )
    stamps_ns = 1000 * np.array([int(row[0]) for row in rows])
    is_outage = status == "INS_BAD_GPS_AGREEMENT"
    assert set(status) == {"INS_SOLUTION_GOOD", "INS_BAD_GPS_AGREEMENT"}
    assert 0.01 < is_outage.mean() < 0.4
    # 50 rows a second
    assert set(np.diff(stamps_ns)) == {20_000_000}
    assert north.astype(float)[0] == pytest.approx(ORIGIN_M[0], abs=500)
    known = np.isfinite(log.world_T_scan).all((1, 2))
    # A sweep at a row's stamp needs that row, one between two rows both.
    after = np.searchsorted(stamps_ns, log.stamps_ns)
    before = np.where(stamps_ns[after] == log.stamps_ns, after, after - 1)
    assert known.tolist() == (~is_outage[before] & ~is_outage[after]).tolist()
    assert np.isfinite(log.odom_T_scan).all()


def test_odometry_drifts_little_over_a_submap(log: Log):
    placed = np.isfinite(log.world_T_scan).all((1, 2))
    end = np.arange(200, len(log.stamps_ns), 10)
    end = end[placed[end] & placed[end - 200]]  # 80 m
    true, reported = (
        np.linalg.inv(poses[end]) @ poses[end - 200]
        for poses in (log.world_T_scan, log.odom_T_scan)
    )
    drift_m = np.linalg.norm(true[:, :3, 3] - reported[:, :3, 3], axis=1)
    assert len(end) > 20
    assert 0.05 < np.median(drift_m) < 1.5
    turn = true @ np.linalg.inv(reported)
    assert np.median(np.abs(np.rad2deg(np.arctan2(turn[:, 1, 0], turn[:, 0, 0])))) < 2.0


def test_processes_record_the_bytes_of_one_worker(
    town: Simulation, logs: tuple[Path, Path], tmp_path: Path
):
    recording = record(town, TEST, tmp_path, compute=Compute("processes", 2))
    assert contents(tmp_path) == contents(logs[0])
    assert str(recording).startswith("1000 sweeps, ")


def test_all_ways_of_a_town_are_roads(town: Simulation):
    assert not town.routes().streets.is_path.any()
