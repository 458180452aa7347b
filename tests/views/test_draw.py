"""Drawing blocks of submaps from a scans artifact."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline import store
from pipeline.running.compute import Compute
from pipeline.schemas import SCANS, SUBMAPS
from pipeline.views import draw
from pipeline.views.draw import Drawing

LENGTHS = (3, 0, 5, 2, 4)


@pytest.fixture
def scans(tmp_path: Path) -> store.Artifact:
    """Five scans of 3, 0, 5, 2 and 4 points; every coordinate of scan i's points is i + 1 metres."""
    points = np.repeat(np.arange(1, 6), LENGTHS)[:, None] * np.full(3, 200)
    with store.write(tmp_path / "a.zarr", SCANS, grain_m=0.005, skipped={}, clipped=0) as draft:
        draft.put("points", points.astype(np.int16))
        draft.put("offsets", np.concatenate([[0], np.cumsum(LENGTHS)]))
        draft.put("stamps_ns", np.arange(5))
        draft.put("world_T_scan", np.tile(np.eye(4), (5, 1, 1)))
        draft.put("odom_T_scan", np.full((5, 4, 4), np.nan))
    return store.read(tmp_path / "a.zarr", SCANS)


@pytest.fixture
def drawing(tmp_path: Path, scans: store.Artifact) -> Callable[..., Drawing]:
    """Submaps of single scans, given as rows."""

    def draw(*rows: int, ground_m: float = 0.0) -> Drawing:
        path = tmp_path / f"submaps{rows}{ground_m}.zarr"
        with store.write(path, SUBMAPS, layout="world_T_scan", left_out={}) as draft:
            for name in ("first", "scans", "stamps_ns"):
                draft.put(name, np.array(rows, np.int64))
            draft.put("ground_m", np.full(len(rows), ground_m))
            draft.put("used", np.ones(5, bool))
            draft.put("world_T_anchor", np.tile(np.eye(4), (len(rows), 1, 1)))
        return Drawing(scans, store.read(path, SUBMAPS), summary)

    return draw


def summary(points_m: np.ndarray) -> np.ndarray:
    """How many points, and the sum of their z."""
    return np.array([len(points_m), points_m[:, 2].sum()], np.float32)


def images(drawing: Drawing, workers: int = 1) -> np.ndarray:
    return np.concatenate(list(drawing.blocks(Compute(workers=workers))))


def test_each_submap_is_drawn_from_its_own_points_in_metres(drawing: Callable[..., Drawing]) -> None:
    assert len(drawing(0, 2, 3, 4)) == 4
    np.testing.assert_allclose(images(drawing(0, 2, 3, 4)), [[3, 3], [5, 15], [2, 8], [4, 20]], rtol=1e-6)
    np.testing.assert_allclose(images(drawing(2, 3)), [[5, 15], [2, 8]], rtol=1e-6)


def test_a_scan_without_points_is_drawn_too(drawing: Callable[..., Drawing]) -> None:
    np.testing.assert_allclose(images(drawing(1)), [[0, 0]])


def test_the_ground_is_taken_off_a_submap_that_happens_to_hold_one_scan(drawing: Callable[..., Drawing]) -> None:
    """As 0.25 m off each of 3, 5, 2 and 4 points."""
    np.testing.assert_allclose(images(drawing(0, 2, 3, 4, ground_m=0.25)), [[3, 2.25], [5, 13.75], [2, 7.5], [4, 19]], rtol=1e-6)


@pytest.mark.parametrize("block", [1, 2, 5])
def test_blocks_of_any_size_draw_the_same(drawing: Callable[..., Drawing], monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    whole = images(drawing(*range(5)))
    monkeypatch.setattr(draw, "BLOCK", block)
    np.testing.assert_array_equal(images(drawing(*range(5)), workers=2), whole)
