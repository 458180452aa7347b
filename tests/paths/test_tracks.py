"""Filter, graph and dead reckoning on a drive whose poses are known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.grid import Grid
from pipeline.matching.places import Places
from pipeline.paths import tracks
from pipeline.paths.filter import Filter
from pipeline.paths.graph import Graph
from pipeline.paths.odometry import Odometry
from pipeline.paths.tracks import Track, joined

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


def track(known: list[int], chance: float = 0.995, scale: float = 1.0) -> Track:
    """Fixes at the rows `known`, 5 cm off; odometry starts anywhere and is too long by a factor."""
    steps = np.linalg.inv(TRUE[:-1]) @ TRUE[1:]
    steps[:, :3, 3] *= scale
    odom = [np.eye(4)]
    for step in steps:
        odom.append(odom[-1] @ step)
    world = np.full_like(TRUE, np.nan)
    world[known] = TRUE[known]
    world[known, 0, 3] += np.random.default_rng(0).normal(0, 0.05, len(known))
    seen = np.isin(np.arange(N), known)
    return Track(
        np.array(odom),
        world,
        np.where(seen, chance, 0.0),
        seen,
        np.tile(1e-4 * np.eye(6), (N, 1, 1)),
    )


def off_m(path: tracks.Path, seen: Track) -> np.ndarray:
    return np.linalg.norm((path.along(seen).world_T_query - TRUE)[:, :2, 3], axis=1)


def test_odometry_alone_drifts_from_the_first_fix_on_and_knows_nothing_before():
    found = off_m(ODOMETRY, track([10, 40], scale=1.02))
    assert np.isnan(found[:10]).all()
    assert found[10] < 0.2
    # 2 % too long on a circle of radius r: as if round one of 1.02 r, so up to 2 × 0.02 × 40 m =
    # 1.6 m away.
    assert 1.4 < found[10:].max() < 1.8


def test_a_filter_carries_a_fix_on_and_is_less_sure_with_every_metre():
    found = FILTER.along(track([10, 40]))
    assert np.isnan(found.world_T_query[:10]).all()
    assert (found.chance[:10] == 0).all()
    assert found.chance[10] > 0.9
    assert (np.diff(found.chance[10:40]) < 0).all()
    assert found.chance[40] > found.chance[39]
    assert found.world_T_query[39] == pytest.approx(TRUE[39], abs=0.2)


def test_a_filter_believes_no_lone_look_alike():
    """One fix across the circle that claims to be right by .7, between fixes that are."""
    seen = track(list(range(0, 60, 2)))
    seen.world_T_query[31] = TRUE[51]
    seen.chance[31] = 0.7
    assert np.linalg.norm(TRUE[51, :2, 3] - TRUE[31, :2, 3]) > 70
    assert FILTER.along(seen).world_T_query[31] == pytest.approx(TRUE[31], abs=0.2)


def test_a_graph_mends_the_odometry_between_fixes_before_and_after():
    seen = track([*range(0, N, 10), N - 1], scale=1.03)
    alone = off_m(ODOMETRY, seen)
    mended = off_m(GRAPH, seen)
    assert np.isfinite(mended).all()
    assert mended.max() < 0.7  # a quarter of the circle between two fixes
    assert mended.max() < alone.max() / 3


def test_a_graph_is_not_torn_by_a_wrong_fix():
    seen = track([0, 10, 20, 30, 40, 50, 60, 70])
    seen.world_T_query[40] = TRUE[60]
    assert off_m(GRAPH, seen).max() < 0.3


def test_only_fixes_that_keep_a_promise_bind_a_graph_if_the_verdict_is_heeded():
    seen = track([5, 25, 45])
    seen.accepted[:] = False
    assert np.isnan(GRAPH.along(seen).world_T_query).all()
    heedless = Graph(False, 0.05, 0.2, 0.1, 0.5, 2.0).along(seen)
    assert np.isfinite(heedless.world_T_query).all()
    assert (heedless.chance > 0.5).any()


@pytest.mark.parametrize("path", [FILTER, GRAPH, ODOMETRY])
def test_nothing_is_carried_over_a_gap_in_the_odometry(path: Path):
    seen = track([10])
    seen.odom_T_query[30] = np.nan
    found = path.along(seen)
    assert np.isfinite(found.world_T_query[29]).all()
    assert np.isnan(found.world_T_query[31:]).all()
    assert (found.chance[31:] == 0).all()


def test_the_artifact_of_a_drive_is_written_anew(tmp_path: Path) -> None:
    """A query without a pose gets its neighbour's, carried; its place is the cell that it stands
    in, and it is accepted."""
    seen = track([row for row in range(N) if row != 22])
    k = 3
    path = tmp_path / "day.zarr"
    places = Places(Grid(10.0, (-60.0, 60.0), (-60.0, 60.0)), np.arange(144))
    columns = {
        "places": np.tile(np.arange(k), (N, 1)),
        "costs": np.tile(np.arange(k, dtype=np.float32), (N, 1)),
        "xy_m": np.zeros((N, k, 2)),
        "novelty": np.stack([1 - seen.chance, 1 - seen.chance], axis=1).astype(np.float32),
        "confidence": seen.chance.astype(np.float32),
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
        "wanted_precision": 0.9,
        "right_within": [2.0, 5.0],
    }
    attrs |= {"promises": [0.95, 0.99, 0.999], "promised": [0.7, 0.6, 0.0], "held_out": 300} | {
        key: [0.3, 0.2, 0.1] for key in ("promised_place", "promised_several")
    }
    with store.draft(path, schemas.Fixes, **attrs) as out:
        for name, values in columns.items():
            out.put(name, values)
    fixes = joined(store.read(path, schemas.Fixes), seen.odom_T_query, FILTER, places)
    store.write(tmp_path / "anew.zarr", fixes)
    assert fixes.world_T_query[22] == pytest.approx(TRUE[22], abs=0.2)
    assert fixes.places[22].tolist()[0] == places.at(TRUE[22:23, :2, 3])[0]
    assert fixes.novelty[22, 0] < fixes.promised[1] == pytest.approx(0.01)
    assert fixes.novelty[22, 1] == columns["novelty"][22, 1]
    assert fixes.thresholds == pytest.approx([0.1, 0.5])
    assert np.isnan(fixes.covariance).all()
    # place and several were judged of each query's own pose
    assert max((*fixes.promised_place, *fixes.promised_several)) < 0
    with pytest.raises(InputError, match="80 queries in 1 cases of 79 submaps"):
        joined(store.read(path, schemas.Fixes), seen.odom_T_query[1:], FILTER, places)
