"""Filter, graph and dead reckoning along a drive whose true poses are known."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.grid import Grid
from pipeline.core.progress import Progress
from pipeline.mapping.submaps import Accumulated, SingleScan
from pipeline.matching.places import Places
from pipeline.paths import tracks
from pipeline.paths.filter import Filter
from pipeline.paths.graph import Graph
from pipeline.paths.odometry import Odometry
from pipeline.paths.tracks import Track, joined
from stages.paths import view_reach_m
from tests.artifacts import write_scans

FILTER = Filter()
GRAPH = Graph(True, 0.05, 0.2, 0.1, 0.5, 2.0)
ODOMETRY = Odometry()
N = 80


def circle() -> np.ndarray:
    """A drive (N, 4, 4) twice round a circle of 40 m, 6.3 m a step."""
    angle = 4 * np.pi * np.arange(N) / N
    poses = np.tile(np.eye(4), (N, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("z", (angle + np.pi / 2)[:, None]).as_matrix()
    poses[:, :2, 3] = 40 * np.stack([np.cos(angle), np.sin(angle)], 1)
    return poses


TRUE = circle()


def track(fixed: list[int], probability: float = 0.995, scale: float = 1.0) -> Track:
    """A track with fixes at the rows `fixed`, 5 cm off, and odometry that is `scale` times too
    long."""
    steps = np.linalg.inv(TRUE[:-1]) @ TRUE[1:]
    steps[:, :3, 3] *= scale
    odom = [np.eye(4)]
    for step in steps:
        odom.append(odom[-1] @ step)
    world = np.full_like(TRUE, np.nan)
    world[fixed] = TRUE[fixed]
    world[fixed, 0, 3] += np.random.default_rng(0).normal(0, 0.05, len(fixed))
    has_fix = np.isin(np.arange(N), fixed)
    return Track(
        np.array(odom),
        world,
        np.where(has_fix, probability, 0.0),
        has_fix,
        np.tile(1e-4 * np.eye(6), (N, 1, 1)),
        0.99 * has_fix,
    )


def off_m(path: tracks.Path, seen: Track) -> np.ndarray:
    """How far the estimates (N,) along a track are from the true poses, in metres."""
    return np.linalg.norm((path.along(seen).world_T_query - TRUE)[:, :2, 3], axis=1)


def test_dead_reckoning_drifts_from_the_first_fix_on_and_has_no_estimate_before():
    found = off_m(ODOMETRY, track([10, 40], scale=1.02))
    assert np.isnan(found[:10]).all()
    assert found[10] < 0.2
    # Odometry that is 2 % too long goes round a circle of 1.02 × 40 m: it is up to 2 × 0.02 × 40 m
    # = 1.6 m away.
    assert 1.4 < found[10:].max() < 1.8


def test_a_filter_carries_a_fix_on_and_is_less_sure_with_every_metre():
    found = FILTER.along(track([10, 40]))
    assert np.isnan(found.world_T_query[:10]).all()
    assert (found.probability[:10] == 0).all()
    assert found.probability[10] > 0.9
    assert (np.diff(found.probability[10:40]) < 0).all()
    assert found.probability[40] > found.probability[39]
    assert found.world_T_query[39] == pytest.approx(TRUE[39], abs=0.2)


def test_a_filter_of_level_sweeps_is_less_sure_of_a_carried_fix_since_right_is_narrower():
    """A level pose is right within 1 m: a drift of 1 m loses it more often than 2 m."""
    seen = track([10])
    level = FILTER.along(replace(seen, right_within=(1.0, 10.0)))
    assert (level.probability[14:30] < FILTER.along(seen).probability[14:30]).all()


def test_a_filter_accepts_no_single_perceptual_alias():
    """One fix lies across the circle and has a probability of .7; those before and after it are
    right."""
    seen = track(list(range(0, 60, 2)))
    seen.world_T_query[31] = TRUE[51]
    seen.probability[31] = 0.7
    assert np.linalg.norm(TRUE[51, :2, 3] - TRUE[31, :2, 3]) > 70
    assert FILTER.along(seen).world_T_query[31] == pytest.approx(TRUE[31], abs=0.2)


def test_a_filter_accepts_no_pose_that_the_querys_own_scan_does_not_show():
    """Rows 20 to 39 have no fix, or one across the circle: odometry alone gives poses there."""
    none = track([row for row in range(N) if not 20 <= row < 40])
    across = track(list(range(N)))
    across.world_T_query[20:40] = np.roll(TRUE, 20, axis=0)[20:40]
    across.probability[20:40] = 0.3
    unlikely = track(list(range(N)))
    unlikely.probability[20:40] = 0.4  # more probably wrong than right by its own scan
    for seen in (none, across, unlikely):
        seen.accepted_at[20:40] = 0.0
        found = FILTER.along(seen)
        accepted = found.accepted(0.99)
        assert found.world_T_query[25] == pytest.approx(TRUE[25], abs=0.2)
        assert accepted[10:20].all()
        assert not accepted[20:40].any()
        assert accepted[-10:].all()
    assert FILTER.along(unlikely).probability[25] > 0.99


def test_a_track_of_a_filter_starts_only_from_a_fix_that_its_own_scan_accepts():
    seen = track(list(range(N)), probability=0.9)
    seen.accepted_at[:] = 0.0
    found = FILTER.along(seen)
    assert (found.probability[10:] > 0.99).all()
    assert not found.accepted(0.95).any()
    seen.accepted_at[30] = 0.95
    found = FILTER.along(seen)
    assert not found.accepted(0.95)[:30].any()
    assert found.accepted(0.95)[30:].all()
    assert not found.accepted(0.99).any()  # a track is no more precise than its start


def test_a_filter_accepts_no_pose_of_a_robot_that_was_carried_off_unseen():
    """At row 40 the robot is set down across the circle; its odometry goes on as if it had not."""
    seen = track(list(range(N)))
    seen.world_T_query[40:] = np.roll(TRUE, 10, axis=0)[40:]
    found = FILTER.along(seen)
    off = np.linalg.norm((found.world_T_query - seen.world_T_query)[:, :2, 3], axis=1)
    assert found.accepted(0.99)[5:40].all()
    assert off[40] > 10  # it is still believed on its way, and rejected
    assert not found.accepted(0.99)[40]
    assert (off[found.accepted(0.99)] < 2).all()
    assert found.accepted(0.99)[45:].all()


def test_a_filter_of_a_robot_that_stands_accepts_no_more_than_its_scan():
    seen = track(list(range(N)), probability=0.9)
    seen.odom_T_query[:] = np.eye(4)
    seen.world_T_query[:] = TRUE[0]
    seen.accepted_at[1:] = 0.0
    found = FILTER.along(seen)
    assert found.probability == pytest.approx(np.full(N, 0.9))
    assert np.flatnonzero(found.accepted(0.95)).tolist() == [0]


def test_a_graph_corrects_the_odometry_between_fixes_before_and_after():
    seen = track([*range(0, N, 10), N - 1], scale=1.03)
    alone = off_m(ODOMETRY, seen)
    fixed = off_m(GRAPH, seen)
    assert np.isfinite(fixed).all()
    assert fixed.max() < 0.7  # between two fixes lies a quarter of the circle
    assert fixed.max() < alone.max() / 3


def test_a_graph_is_not_distorted_by_a_wrong_fix():
    seen = track([0, 10, 20, 30, 40, 50, 60, 70])
    seen.world_T_query[40] = TRUE[60]
    assert off_m(GRAPH, seen).max() < 0.3


def test_only_accepted_fixes_are_priors_of_a_graph_that_uses_the_verdict():
    seen = track([5, 25, 45])
    seen.accepted[:] = False
    assert np.isnan(GRAPH.along(seen).world_T_query).all()
    of_all_fixes = Graph(False, 0.05, 0.2, 0.1, 0.5, 2.0).along(seen)
    assert np.isfinite(of_all_fixes.world_T_query).all()
    assert (of_all_fixes.probability > 0.5).any()


@pytest.mark.parametrize("path", [FILTER, GRAPH, ODOMETRY])
def test_nothing_is_carried_over_a_gap_in_the_odometry(path: Path):
    seen = track([10])
    seen.odom_T_query[30] = np.nan
    found = path.along(seen)
    assert np.isfinite(found.world_T_query[29]).all()
    assert np.isnan(found.world_T_query[31:]).all()
    assert (found.probability[31:] == 0).all()


def test_the_fixes_of_a_drive_are_replaced_by_estimates(tmp_path: Path) -> None:
    """A query without a fix gets its neighbour's, moved by odometry, and is rejected.

    Its first place is the cell that this pose lies in.
    """
    seen = track([row for row in range(N) if row != 22])
    k = 3
    path = tmp_path / "day.zarr"
    places = Places(Grid(10.0, (-60.0, 60.0), (-60.0, 60.0)), np.arange(144))
    columns = {
        "places": np.tile(np.arange(k), (N, 1)),
        "costs": np.tile(np.arange(k, dtype=np.float32), (N, 1)),
        "xy_m": np.zeros((N, k, 2)),
        "novelty": np.stack([1 - seen.probability, 1 - seen.probability], axis=1).astype(
            np.float32
        ),
        "confidence": seen.probability.astype(np.float32),
        "heading_deg": np.zeros((N, k), np.float32),
        "turned_deg": np.zeros(N, np.float32),
        "world_T_query": seen.world_T_query,
        "covariance": seen.covariance,
        "overlap": np.full(N, 0.5, np.float32),
    }
    case = {"change": "", "level": 0.0, "shadow": False, "repeat": 0}
    attrs = {
        "cases": [case],
        "kinds": ["fix", "place"],
        "thresholds": [0.6, 0.5],
        "target_precision": 0.9,
        "right_within": [2.0, 5.0],
    }
    attrs |= {
        "target_precisions": [0.95, 0.99, 0.999],
        "pose_thresholds": [0.7, 0.6, 0.0],
        "place_thresholds": [0.3, 0.2, 0.1],
        "several_thresholds": [0.3, 0.2, 0.1],
        "validation_blocks": 300,
    }
    with store.draft(path, schemas.Fixes, **attrs) as out:
        for name, values in columns.items():
            out.put(name, values)
    fixes = joined(store.read(path, schemas.Fixes), seen.odom_T_query, FILTER, places)
    store.write(tmp_path / "again.zarr", fixes)
    assert fixes.world_T_query[22] == pytest.approx(TRUE[22], abs=0.2)
    assert fixes.places[22].tolist()[0] == places.at(TRUE[22:23, :2, 3])[0]
    assert fixes.pose_thresholds == pytest.approx([0.05, 0.01, 0.001])
    assert fixes.novelty[22, 0] > fixes.pose_thresholds[0]
    assert fixes.confidence[22] > 0.99
    # the fix of row 50 is accepted at .99 alone, since 1 − .995 is below .6 but not below 0
    assert fixes.confidence[50] > 0.999
    assert fixes.pose_thresholds[2] < fixes.novelty[50, 0] < fixes.pose_thresholds[1]
    assert fixes.novelty[22, 1] == columns["novelty"][22, 1]
    assert fixes.thresholds == pytest.approx([0.1, 0.5])
    assert np.isnan(fixes.covariance).all()
    # the claims place and several were judged at each query's own fix, so they are never accepted
    assert max((*fixes.place_thresholds, *fixes.several_thresholds)) < 0
    with pytest.raises(InputError, match="80 queries in 1 cases of 79 submaps"):
        joined(store.read(path, schemas.Fixes), seen.odom_T_query[1:], FILTER, places)


def test_the_next_view_of_gathered_scans_begins_where_they_are_all_others(tmp_path: Path) -> None:
    """Submaps gather the last 2 m; level sweeps are gathered over 5 m whatever the submaps are, and
    of single scans half a metre is enough."""
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6)
    scans = write_scans(tmp_path / "scans.zarr", [np.array([[5.0, 0.0, 1.0]])] * 6, poses)
    single = SingleScan(step_m=1.0).cut(scans, Progress())
    gathered = Accumulated(window_m=2.0, ground_percentile=-1.0).cut(scans, Progress())
    of_scans = SimpleNamespace(right_within=(2.0, 5.0))
    of_sweeps = SimpleNamespace(right_within=(1.0, 10.0))
    assert view_reach_m(of_scans, scans, single) == 0.5
    assert view_reach_m(of_scans, scans, gathered) == pytest.approx(2.0)
    assert view_reach_m(of_sweeps, scans, gathered) == 5.0
