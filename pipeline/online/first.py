"""Compiles all that localising needs with a made-up scan, so that later scans find it compiled."""

import time

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose
from pipeline.core.progress import Progress
from pipeline.formats import kitti, nclt
from pipeline.formats.pointcloud2 import finite
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.sweeps import OVER_M, Gatherer
from pipeline.matching.outlines import Outlines, outlines, reranked
from pipeline.matching.ranking import Rows
from pipeline.methods.scan_context import ScanContext50
from pipeline.online.tilt import lean
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import GRAIN_M, Targets
from pipeline.views.m2dp import M2dp
from pipeline.views.scan_context import ScanContext

APART_M = 4.0
"""Distance from one made-up submap to the next."""


def compile_kernels() -> float:
    """Draw, rank, register and check a scan in a made-up street; returns the seconds that it took.

    A compressed PCD has a kernel of its own, which the first such file compiles.
    """
    start = time.perf_counter()
    points_m = street()
    anchors = np.tile(np.eye(4), (3, 1, 1))
    anchors[:, 0, 3] = APART_M * np.arange(len(anchors))
    clouds_m = [points_m - anchor[:3, 3] for anchor in anchors]
    _formats(points_m)
    lean(points_m)
    localize_level()
    M2dp()(points_m)
    images = np.stack([ScanContext()(cloud_m) for cloud_m in clouds_m])
    rows = Rows(images, np.arange(len(anchors)), anchors)
    ranker = ScanContext50(candidates=len(anchors))
    ranker.localizer(ranker.learn(rows, np.arange(len(anchors)), Progress()))(rows, 1)
    image_outlines = outlines(images)
    trained = Outlines(image_outlines, np.arange(len(anchors)), np.zeros(len(anchors), np.float32))
    scores_shape = (len(anchors), len(anchors))
    reranked(np.ones(scores_shape), np.zeros(scores_shape), image_outlines, trained)
    grains = [np.rint(cloud_m / GRAIN_M).astype(np.int64) for cloud_m in clouds_m]
    offsets = np.cumsum([0, *map(len, grains)])
    arrays = {
        "points": np.concatenate(grains).astype(np.int16),
        "offsets": offsets,
        "world_T_anchor": anchors,
    }
    targets = Targets(arrays, GRAIN_M, 80.0, True)
    Fixer(sure=1.0).fix(clouds_m[1], targets, Answers(anchors[:, :2, 3], np.zeros(len(anchors))))
    return time.perf_counter() - start


def localize_level() -> None:
    """Gather two sweeps in a made-up room, and search its map for them."""
    angles = np.linspace(-np.pi, np.pi, 360)
    walls_m = np.minimum(
        3 / np.maximum(np.abs(np.cos(angles)), 1e-9), 2 / np.maximum(np.abs(np.sin(angles)), 1e-9)
    )
    sweeps_m = [np.column_stack([walls_m * np.cos(angles), walls_m * np.sin(angles)])]
    step = np.eye(4)
    step[0, 3] = APART_M / 8
    sweeps_m.append(sweeps_m[0] - step[:2, 3])
    drawing = Drawing.of(sweeps_m, np.stack([np.eye(4), step]))
    field = Field.of(drawing.level_map(np.array([False, True])))
    gatherer = Gatherer()
    gatherer.add(sweeps_m[0], None)
    gatherer.add(sweeps_m[1], step)
    LevelFixer().fix(field, gatherer.gathered(OVER_M))


def street() -> NDArray[np.float64]:
    """Points (n, 3) of a ground and of houses on both sides."""
    rng = np.random.default_rng(0)
    parts = [np.column_stack([rng.uniform(-40, 40, (4000, 2)), rng.normal(0, 0.02, 4000)])]
    for x_m in range(-36, 36, 12):
        front = np.column_stack(
            [rng.uniform(x_m, x_m + 8, 400), np.full(400, 9.0), rng.uniform(0, 7, 400)]
        )
        side = np.column_stack(
            [np.full(400, float(x_m)), rng.uniform(9, 15, 400), rng.uniform(0, 7, 400)]
        )
        parts += [front, side, front * (1, -1, 1), side * (1, -1, 1)]
    return np.concatenate(parts) @ pose(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.3]]))[0, :3, :3].T


def _formats(points_m: NDArray[np.float64]) -> None:
    """Read the points as the bytes of PointCloud2, KITTI and NCLT scans."""
    fields = np.zeros(
        len(points_m), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
    )
    fields["x"], fields["y"], fields["z"] = points_m.T
    finite(*(fields[axis] for axis in "xyz"))
    kitti.decode(np.frombuffer(fields.tobytes(), "<f4"), 0.0)
    packed = nclt.encode(
        points_m.astype(np.float32),
        np.zeros(len(points_m), np.uint8),
        np.zeros(len(points_m), np.uint8),
    )
    nclt.decode(np.frombuffer(packed, "<u2"), 0.0)
    nclt.decode(np.frombuffer(packed, "<u2"))
