"""The scanner car of the suburb: its logs, read back by the KITTI reader."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.readers.kitti import Kitti, read_poses
from tests.worlds.helpers import ALONE, contents, off_walls_m, record, shares
from worlds.driving.drive import CAR, drive
from worlds.driving.recorder import Recording
from worlds.layout.blocks import build_campus
from worlds.layout.shapes import Kind
from worlds.names import KITTI_DATE
from worlds.simulation import Simulation

READER = Kitti(root_per_sequence=True)
Logs = tuple[Path, Path, Recording]
"""The folders of the logs and of the ground truth, and what was recorded."""
LOGS = {"00": {"unseen": 0.1, "reversed": 0.3}, "01": {"unseen": 0.1, "reversed": 0.0}}


@pytest.fixture(scope="module")
def suburb() -> Simulation:
    """Two logs of 960 m, with a scan of 64 × 120 rays every 8 m."""
    return Simulation(
        2, 4, 960.0, 8.0, 120, LOGS, events_per_km_of_route=0.0, robot="scanner_car", logs="kitti"
    )


@pytest.fixture(scope="module")
def logs(suburb: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Logs:
    """A recording of log 00."""
    root = tmp_path_factory.mktemp("logs")
    ground_truth = tmp_path_factory.mktemp("ground_truth")
    return root, ground_truth, record(suburb, "00-a", root, ground_truth, Compute(workers=2))


@pytest.fixture(scope="module")
def true_poses(suburb: Simulation) -> np.ndarray:
    """World poses (scan, 4, 4) of log 00's lidar."""
    routes, plan = suburb.plan_of("00")
    ground = build_campus(routes.seed, suburb.blocks, routes.streets).ground
    driven = drive(routes.seed, KITTI_DATE, plan.line_m, ground, suburb.route_m, suburb.step_m, CAR)
    up = np.eye(4)
    up[2, 3] = 1.73
    return driven.world_T_body[driven.scan_rows] @ up


def test_a_log_is_a_kitti_root_in_its_own_folder(logs: Logs):
    folder = logs[0] / "00-a"
    recording = logs[2]
    assert sorted(
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.is_file() and path.suffix == ".txt"
    ) == [
        "poses/00.txt",
        "sequences/00/calib.txt",
        "sequences/00/times.txt",
    ]
    scans = sorted((folder / "sequences" / "00" / "velodyne").iterdir())
    assert [path.name for path in scans] == [f"{scan:06d}.bin" for scan in range(recording.scans)]
    assert sum(path.stat().st_size for path in scans) == 16 * recording.points
    # 8 m at 8 m/s
    assert (folder / "sequences" / "00" / "times.txt").read_text().splitlines()[:2] == [
        "0.000000e+00",
        "1.000000e+00",
    ]
    assert [
        line.split(":")[0]
        for line in (folder / "sequences" / "00" / "calib.txt").read_text().splitlines()
    ] == [*("P0", "P1", "P2", "P3", "Tr")]


def test_poses_are_those_of_the_camera_in_its_first_frame(logs: Logs, true_poses: np.ndarray):
    folder = logs[0] / "00-a"
    rows = np.loadtxt(folder / "poses" / "00.txt")
    assert rows[0] == pytest.approx([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], abs=1e-9)
    # The camera looks along its z axis: so far forward does the car go in 8 m.
    assert rows[1, 11] == pytest.approx(8.0, abs=0.1)
    found = read_poses(folder / "poses" / "00.txt", folder / "sequences" / "00" / "calib.txt")
    assert found == pytest.approx(np.linalg.inv(true_poses[0]) @ true_poses, abs=1e-6)


def test_the_poses_put_every_wall_point_on_a_wall(
    suburb: Simulation, logs: Logs, true_poses: np.ndarray
):
    log = READER.open(logs[0], "00-a")
    kinds = sorted((logs[1] / "00-a" / "kinds").iterdir())
    down = np.array([0, 0, 1.73])
    walls_m = []
    for row in range(len(log.stamps_ns)):
        points_m = log.points(row)[np.load(kinds[row]) == Kind.BUILDING]
        points_m = points_m @ log.world_T_scan[row, :3, :3].T + log.world_T_scan[row, :3, 3]
        walls_m.append((points_m - down) @ true_poses[0, :3, :3].T + true_poses[0, :3, 3])
    assert log.world_T_scan[0] == pytest.approx(np.eye(4), abs=1e-6)
    walls_m = np.concatenate(walls_m)
    assert len(walls_m) > 500
    # 2 cm of noise: 5 sds
    assert off_walls_m(suburb, "00", walls_m, suburb.plan_of("00")[0]).max() < 0.11


def test_scans_lie_on_the_road(logs: Logs):
    log = READER.open(logs[0], "00-a")
    heights_m = [
        np.median(p[np.hypot(p[:, 0], p[:, 1]) < 6, 2])
        for p in map(log.points, range(len(log.stamps_ns)))
    ]
    assert abs(np.median(heights_m)) < 0.03


def test_the_second_half_revisits_the_first(suburb: Simulation, logs: Logs):
    recording = logs[2]
    assert (recording.unseen, recording.reversed) == pytest.approx((0.1, 0.3), abs=0.1)
    root = logs[0]
    (root / "00-b").symlink_to(root / "00-a", target_is_directory=True)
    first, second = (READER.open(root, name).world_T_scan for name in ("00-a", "00-b"))
    (root / "00-b").unlink()
    assert len(first) + len(second) == recording.scans
    # Scans are 8 m apart, and a way back lies 2 × 1.7 m aside.
    assert shares(second, first) == pytest.approx((recording.unseen, recording.reversed), abs=0.1)


def test_both_parts_are_the_same_bytes_however_computed(
    suburb: Simulation, logs: Logs, tmp_path: Path
):
    record(suburb, "00-b", tmp_path, compute=ALONE)
    assert contents(tmp_path / "00-b") == contents(logs[0] / "00-a")


def test_every_log_has_a_place_of_its_own(suburb: Simulation):
    streets = [suburb.plan_of(log)[0].streets.nodes_m for log in LOGS]
    assert np.abs(streets[0][:5] - streets[1][:5]).max() > 1.0
