"""A campus drive recorded as NCLT logs: its files, and what their bytes depend on."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.core.compute import Compute
from tests.worlds.helpers import EVEN, contents, off_walls_m, record, refused
from worlds import simulation
from worlds.driving.recorder import Recording
from worlds.layout.shapes import Kind
from worlds.simulation import Simulation

TRAINING = "2012-01-15"
TEST = "2012-02-04"
SUMMER = "2012-06-15"
Logs = tuple[Path, Path, Recording]
"""The folders of the logs and of the ground truth, and what was recorded."""


@pytest.fixture(scope="module")
def logs(small: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Logs:
    """A recording of the summer sequence."""
    root = tmp_path_factory.mktemp("logs")
    ground_truth = tmp_path_factory.mktemp("ground_truth")
    return root, ground_truth, record(small, SUMMER, root, ground_truth=ground_truth)


@pytest.fixture(scope="module")
def ground_truth(logs: Logs) -> np.ndarray:
    """Rows of the true poses: stamp, x, y, z, roll, pitch, yaw."""
    return np.loadtxt(logs[0] / SUMMER / f"groundtruth_{SUMMER}.csv", delimiter=",")


@pytest.fixture(scope="module")
def scans(logs: Logs) -> dict[int, np.ndarray]:
    """The records of each scan by its stamp, in order."""
    record = np.dtype([("xyz", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])
    return {
        int(path.stem): np.fromfile(path, record)
        for path in sorted((logs[0] / SUMMER / "velodyne_sync").iterdir())
    }


def test_the_logs_have_the_layout_of_nclt(logs: Logs):
    root, _, recording = logs
    names = [
        f"groundtruth_{SUMMER}.csv",
        "odometry_cov.csv",
        "odometry_mu_100hz.csv",
        "velodyne_sync",
    ]
    assert sorted(path.name for path in (root / SUMMER).iterdir()) == names
    scans = sorted((root / SUMMER / "velodyne_sync").iterdir())
    assert len(scans) == recording.scans == 25
    assert all(len(path.stem) == 16 and path.suffix == ".bin" for path in scans)
    assert sum(path.stat().st_size for path in scans) == 8 * recording.points


def test_the_ground_truth_opens_with_gaps_and_spans_the_scans(
    ground_truth: np.ndarray, scans: dict[int, np.ndarray]
):
    assert ground_truth.shape[1] == 7
    assert np.isnan(ground_truth[:5, 1:]).all()
    assert np.isfinite(ground_truth[5:]).all()
    assert (np.diff(ground_truth[:, 0]) > 0).all()
    stamps = list(scans)
    assert ground_truth[5, 0] < stamps[0]
    assert stamps[-1] < ground_truth[-1, 0]
    assert set(stamps) <= set(ground_truth[:, 0].astype(int).tolist())
    # 15 June 2012, 14:00 UTC
    assert ground_truth[0, 0] == 1339768800 * 1e6


def test_scans_lie_on_the_ground_in_the_forward_right_down_frame(scans: dict[int, np.ndarray]):
    heights_m = []
    for raw in scans.values():
        points = raw["xyz"] * 0.005 - 100.0
        low = points[(np.hypot(points[:, 0], points[:, 1]) < 5.0) & (points[:, 2] > -0.5)]
        # The robot rocks on a slope, so the ground is a tilted plane: its height at the origin is
        # what counts.
        plane = np.linalg.lstsq(
            np.column_stack([low[:, :2], np.ones(len(low))]), low[:, 2], rcond=None
        )[0]
        heights_m.append(plane[2])
        # z is down: what stands on the ground is at negative z.
        assert points[:, 2].min() < -1.0
    assert abs(np.median(heights_m)) < 0.03
    assert np.abs(heights_m).max() < 0.15
    assert set(np.concatenate([raw["laser"] for raw in scans.values()]).tolist()) == set(range(32))


def test_the_ground_truth_puts_every_wall_point_on_a_wall(
    small: Simulation, logs: Logs, ground_truth: np.ndarray, scans: dict[int, np.ndarray]
):
    points_m = []
    for stamp, raw in scans.items():
        row = ground_truth[np.searchsorted(ground_truth[:, 0], stamp)]
        walls = np.load(logs[1] / SUMMER / "kinds" / f"{stamp}.npy") == Kind.BUILDING
        ned = (
            Rotation.from_euler("xyz", row[4:]).apply(raw["xyz"][walls] * 0.005 - 100.0) + row[1:4]
        )
        points_m.append(ned * (1, -1, -1))
    assert sum(map(len, points_m)) > 500
    # Range noise has an sd of 2 cm and never helps: 5 sds, and the grain of 5 mm.
    assert off_walls_m(small, SUMMER, np.concatenate(points_m)).max() < 0.11


def test_the_ground_truth_folder_has_the_kind_of_each_point(logs: Logs):
    _, ground_truth, recording = logs
    kinds = np.concatenate(
        [np.load(path) for path in sorted((ground_truth / SUMMER / "kinds").iterdir())]
    )
    assert len(kinds) == recording.points
    assert {Kind.GROUND, Kind.LEAF, Kind.PERSON} <= set(kinds.tolist())
    year = json.loads((ground_truth / SUMMER / "year.json").read_text())
    # 152 days from 15 January to 15 June 2012; 40 events per km over 0.1 km
    assert year["day"] == 152
    assert len(year["events"]) == 4


@pytest.mark.parametrize(
    ("compute", "block"),
    [
        (Compute(workers=2), 25),
        (Compute(workers=1), 7),
        (Compute(workers=2), 4),
        (Compute("processes", 2), None),
    ],
)
def test_neither_workers_nor_blocks_nor_other_sequences_change_a_byte(
    small: Simulation,
    logs: Logs,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    compute: Compute,
    block: int | None,
):
    if block:
        monkeypatch.setattr(simulation, "BLOCK_RAYS", block * 32 * small.azimuths)
    fewer = replace(small, sequences={name: small.sequences[name] for name in (TRAINING, SUMMER)})
    assert record(fewer, SUMMER, tmp_path, compute=compute) == logs[2]
    assert contents(tmp_path) == contents(logs[0])


def test_another_seed_is_another_world(small: Simulation, logs: Logs, tmp_path: Path):
    record(replace(small, seed=4), SUMMER, tmp_path)
    assert contents(tmp_path) != contents(logs[0])


def test_the_training_sequence_sees_nothing_unseen(small: Simulation, tmp_path: Path):
    recording = record(small, TRAINING, tmp_path)
    assert (recording.unseen, recording.reversed) == (0.0, 0.0)
    assert recording.metres == pytest.approx(96.0, abs=0.5)  # 24 gaps of 4 m


def test_an_unknown_sequence_is_one_line_of_error(small: Simulation, tmp_path: Path):
    with refused(r"2011-01-01: not in world\.sequences"):
        record(small, "2011-01-01", tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"blocks": 1},
        {"step_m": 0.0},
        {"seed": -1},
        {"near_route": 1.5},
        {"blocks": "many"},
        {"robot": "boat"},
        {"robot": "push_broom_car"},
        {"logs": "kitti"},
        {"logs": "robotcar"},
        {"logs": "paper"},
        {"sequences": {}},
        {"sequences": {"summer": EVEN}},
        {"sequences": {TRAINING: {**EVEN, "unseen": 0.1}}},
        {"sequences": {TRAINING: {**EVEN, "lateral_m": 2.0}}},
        {"sequences": {TRAINING: EVEN, TEST: {"unseen": 0.1}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "season": 1.0}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "unseen": 1.1}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "reversed": "all"}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "events_per_km": -1.0}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "near_route": 2.0}}},
        {"sequences": {TRAINING: EVEN, TEST: {**EVEN, "lateral_m": -3.5}}},
    ],
)
def test_wrong_parameters_are_one_line_of_error(small: Simulation, wrong: dict[str, object]):
    with refused():
        replace(small, **wrong)
