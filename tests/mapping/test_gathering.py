"""Gathering: scans placed in the newest one's frame, each read once, with the ground at 0."""

import tracemalloc
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.compute import Compute
from pipeline.core.frames import pose
from pipeline.core.progress import Progress
from pipeline.core.schemas import Scans, Submaps
from pipeline.mapping import gathering
from pipeline.mapping.gathering import Gathering
from pipeline.mapping.submaps import Accumulated, SingleScan
from pipeline.views.draw import Drawing
from tests.artifacts import write_scans

NAN4 = np.full((4, 4), np.nan)


def scans(folder: Path, points: list[np.ndarray], start_T_scan: np.ndarray) -> Scans:
    """Write scans of these points, whose odometry is the ground truth too, as an artifact, and open
    it."""
    return write_scans(folder / "scans.zarr", points, start_T_scan)


def driven(n: int, step_m: float = 1.0) -> np.ndarray:
    """Poses (n, 4, 4) along the world's y axis, heading along it: forward in the vehicle is +y."""
    xyz = np.column_stack([np.zeros(n), step_m * np.arange(n), np.zeros(n)])
    return pose(xyz, np.column_stack([np.zeros((n, 2)), np.full(n, np.pi / 2)]))


def gathered(artifact: Scans, made: Submaps) -> Gathering:
    """The points of these submaps."""
    return Gathering(artifact, made.layout, made.first, made.scans, made.ground_m, made.used)


def cut(artifact: Scans, **settings: object) -> Submaps:
    """Submaps of the last 2 m, unless the settings say otherwise."""
    return Accumulated(**{"window_m": 2.0, "ground_percentile": -1.0, **settings}).cut(
        artifact, Progress()
    )


def test_older_scans_lie_behind_in_the_newest_ones_frame(tmp_path: Path) -> None:
    # Each scan sees one point 5 m to its left; one metre of driving puts it a metre behind.
    artifact = scans(tmp_path, [np.array([[0.0, 5.0, 1.0]])] * 4, driven(4))
    one, other = gathered(artifact, cut(artifact))
    np.testing.assert_allclose(one, [[-2, 5, 1], [-1, 5, 1], [0, 5, 1]], atol=1e-9)
    np.testing.assert_allclose(other, one, atol=1e-9)


def test_submaps_gather_over_their_window_and_single_scans_over_no_path(tmp_path: Path) -> None:
    """A metre from scan to scan, and a window of 2 m: the scans of 2 m of path."""
    artifact = scans(tmp_path, [np.array([[0.0, 5.0, 1.0]])] * 6, driven(6))
    assert gathering.gathered_m(artifact, cut(artifact)) == pytest.approx(2.0)
    single = SingleScan(step_m=1.0).cut(artifact, Progress())
    assert gathering.gathered_m(artifact, single) == 0.0


def test_the_ground_is_a_percentile_of_the_heights_around_the_anchor(tmp_path: Path) -> None:
    # 95 points of ground at −2 m, five of a wall above; a pit 50 m away is none of its business.
    cloud = np.concatenate(
        [
            np.tile([3.0, 0, -2.0], (95, 1)),
            np.tile([3.0, 0, 4.0], (5, 1)),
            np.tile([50.0, 0, -9.0], (300, 1)),
        ]
    )
    artifact = scans(tmp_path, [cloud] * 3, driven(3))
    made = cut(artifact, ground_percentile=5.0)
    assert made.ground_m.tolist() == [-2.0]
    assert {round(z, 9) for z in next(iter(gathered(artifact, made)))[:, 2]} == {0.0, 6.0, -7.0}


def test_a_submap_without_ground_is_left_out_and_counted(tmp_path: Path) -> None:
    artifact = scans(tmp_path, [np.array([[40.0, 0, 0]])] * 4, driven(4))
    made = cut(artifact, ground_percentile=5.0)
    assert len(made.scans) == len(made.first) == len(made.ground_m) == 0
    assert made.left_out == Counter({"no point near the anchor": 2, "window not yet whole": 1})


def test_standing_still_adds_nothing(tmp_path: Path) -> None:
    start_T_scan = driven(5)[[0, 1, 1, 1, 2, 3]]
    artifact = scans(tmp_path, [np.full((1, 3), float(row)) for row in range(6)], start_T_scan)
    made = cut(artifact)
    assert made.used.tolist() == [True, True, False, False, True, True]
    assert [len(points) for points in gathered(artifact, made)] == [3, 3]


@pytest.mark.parametrize("block", [1, 3, 256])
def test_each_scan_is_read_once_and_blocks_of_any_size_say_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """Against the definition: every submap put together on its own, from float64 poses."""
    rng = np.random.default_rng(3)
    clouds = [np.round(rng.uniform(-20, 20, (rng.integers(0, 9), 3)), 2) for _ in range(40)]
    ground_truth = pose(
        np.cumsum(rng.uniform(0, 0.6, (40, 3)), axis=0),
        np.cumsum(rng.normal(0, 0.1, (40, 3)), axis=0),
    )
    ground_truth[17] = NAN4
    artifact = scans(tmp_path, clouds, ground_truth)
    made = cut(artifact, window_m=4.0)
    monkeypatch.setattr(gathering, "BLOCK", block)
    moved = Counter[int]()
    plain = gathering.transformed
    monkeypatch.setattr(
        gathering,
        "transformed",
        lambda a_T_b, points: (moved.update([len(points)]), plain(a_T_b, points))[1],
    )
    found = list(gathered(artifact, made))
    assert len(found) == len(made.scans) > 10
    for first, last, points in zip(made.first, made.scans, found, strict=True):
        rows = [row for row in range(first, last + 1) if made.used[row]]
        last_T_row = [np.linalg.inv(ground_truth[last]) @ ground_truth[row] for row in rows]
        wanted = [
            clouds[row] @ a_T_b[:3, :3].T + a_T_b[:3, 3]
            for row, a_T_b in zip(rows, last_T_row, strict=True)
        ]
        np.testing.assert_allclose(points, np.concatenate(wanted), atol=1e-9)
    between = made.used[made.first[0] : made.scans[-1] + 1].sum()
    assert moved.total() <= between + len(found)


def test_views_of_accumulated_submaps_are_drawn_from_all_their_scans(tmp_path: Path) -> None:
    artifact = scans(tmp_path, [np.array([[1.0, 0, row / 2]]) for row in range(4)], driven(4))
    made = cut(artifact)
    store.write(tmp_path / "submaps.zarr", made)
    submaps = store.read(tmp_path / "submaps.zarr", Submaps)
    drawing = Drawing(
        artifact, submaps, lambda points: np.array([len(points), points[:, 2].sum()], np.float32)
    )
    assert len(drawing) == 2
    np.testing.assert_allclose(
        np.concatenate(list(drawing.blocks(Compute()))), [[3, 1.5], [3, 3.0]]
    )


def test_memory_is_that_of_a_window_however_long_the_drive(tmp_path: Path) -> None:
    """Four more kilometres: 8,000 scans of 100 points are 19 MB as float64, their poses 1 MB."""
    peaks = []
    for count in (4_000, 12_000):
        (tmp_path / str(count)).mkdir()
        artifact = scans(tmp_path / str(count), [np.zeros((100, 3))] * count, driven(count, 0.5))
        made = cut(artifact, step_m=20.0, window_m=80.0)
        tracemalloc.start()
        try:
            assert {len(points) for points in gathered(artifact, made)} == {161 * 100}
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] - peaks[0] < 4e6
