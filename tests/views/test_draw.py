"""Drawings of submaps from artifacts of scans and submaps, in blocks."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.views import draw
from pipeline.views.draw import Drawing
from tests.views.made import artifacts

POINTS_M = [np.full((length, 3), scan + 1.0) for scan, length in enumerate((3, 0, 5, 2, 4))]
"""The points of five scans; all coordinates of scan i are i + 1 metres."""


def summary(points_m: np.ndarray) -> np.ndarray:
    """A view of two numbers: how many points there are, and the sum of their z."""
    return np.array([len(points_m), points_m[:, 2].sum()], np.float32)


def images(folder: Path, *rows: int, ground_m: float = 0.0, workers: int = 1) -> np.ndarray:
    """The images of submaps of one scan each, given by their rows."""
    drawing = Drawing(
        *artifacts(folder, POINTS_M, np.tile(np.eye(4), (5, 1, 1)), last=rows, ground_m=ground_m),
        summary,
    )
    assert len(drawing) == len(rows)
    return np.concatenate(list(drawing.blocks(Compute(workers=workers))))


@pytest.mark.parametrize(
    ("rows", "ground_m", "seen"),
    [
        ((0, 2, 3, 4), 0.0, [[3, 3], [5, 15], [2, 8], [4, 20]]),
        ((2, 3), 0.0, [[5, 15], [2, 8]]),
        ((1,), 0.0, [[0, 0]]),  # a scan without points is drawn too
        # 0.25 m are subtracted from the heights of 3, 5, 2 and 4 points
        ((0, 2, 3, 4), 0.25, [[3, 2.25], [5, 13.75], [2, 7.5], [4, 19]]),
    ],
)
def test_each_submap_is_drawn_from_its_own_points_above_its_ground(
    tmp_path: Path, rows: tuple[int, ...], ground_m: float, seen: list[list[float]]
) -> None:
    np.testing.assert_allclose(images(tmp_path, *rows, ground_m=ground_m), seen, rtol=1e-6)


@pytest.mark.parametrize("block", [1, 2, 5])
def test_blocks_of_any_size_draw_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    whole = images(tmp_path / "whole", *range(5))
    monkeypatch.setattr(draw, "BLOCK", block)
    np.testing.assert_array_equal(images(tmp_path / "blocks", *range(5), workers=2), whole)
