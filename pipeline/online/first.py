"""Compiles all numba kernels of localisation, by localising a made-up scan once.

`yearloc kernels` does this, and `make install` calls it, so that no real scan waits for the
compiler.
"""

import time

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import pose, transformed
from pipeline.core.progress import Progress
from pipeline.formats import kitti, nclt
from pipeline.formats.pointcloud2 import finite
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.sweeps import OVER_M, Gatherer
from pipeline.mapping.local_ground import LocalGround
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.matching.ranking import Rows
from pipeline.matching.return_profiles import ReturnProfiles, reranked, return_profiles
from pipeline.methods.bev_correlation import BevCorrelation
from pipeline.methods.scan_context import ScanContext50
from pipeline.online.tilt import lean
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.views.m2dp import M2dp
from pipeline.views.scan_context import ScanContext
from pipeline.views.walls import Walls as WallView

APART_M = 4.0
"""The distance from one made-up submap to the next."""


def compile_kernels() -> float:
    """Localise a scan in a made-up street and a sweep in a room; returns the seconds it took.

    Only the kernel of compressed PCDs is not compiled here, but by the first such file.
    """
    start = time.perf_counter()
    points_m = street()
    _decode_formats(points_m)
    lean(points_m)
    M2dp()(points_m)
    localize_level()
    search_map(points_m)

    # the street as three submaps, one APART_M from the next
    count = 3
    anchors = np.tile(np.eye(4), (count, 1, 1))
    anchors[:, 0, 3] = APART_M * np.arange(count)
    clouds_m = [points_m - anchor[:3, 3] for anchor in anchors]

    # draw and rank the submaps, by both rankers that have kernels
    images = np.stack([ScanContext()(cloud_m) for cloud_m in clouds_m])
    rows = Rows(images, np.arange(count), anchors)
    ranker = ScanContext50(candidates=count)
    ranker.localizer(ranker.learn(rows, np.arange(count), Progress()))(rows, 1)
    image_return_profiles = return_profiles(images)
    trained = ReturnProfiles(image_return_profiles, np.arange(count), np.zeros(count, np.float32))
    reranked(np.ones((count, count)), np.zeros((count, count)), image_return_profiles, trained)

    # register one submap with the map of all three
    grains = [np.rint(cloud_m / GRAIN_M).astype(np.int64) for cloud_m in clouds_m]
    offsets = np.cumsum([0, *map(len, grains)])
    arrays = {
        "points": np.concatenate(grains).astype(np.int16),
        "offsets": offsets,
        "world_T_anchor": anchors,
    }
    targets = Targets(arrays, GRAIN_M, 80.0, True)
    answers = Answers(anchors[:, :2, 3], np.zeros(count))
    Fixer(sure=1.0).fix(clouds_m[1], targets, answers)  # never sure enough: all steps are taken
    return time.perf_counter() - start


def search_map(points_m: NDArray[np.float64]) -> None:
    """Fit the ground of points (n, 3), draw their walls from above, and search these for them."""
    LocalGround.of([points_m])
    images = np.stack([WallView()(points_m)] * 2)
    rows = Rows(images, np.arange(2), np.tile(np.eye(4), (2, 1, 1)))
    method = BevCorrelation()
    method.localizer(method.learn(rows, np.arange(2), Progress()))(rows, 1)


def localize_level() -> None:
    """Gather two sweeps in a made-up room of 6 x 4 m, and search its map for them."""
    angles = np.linspace(-np.pi, np.pi, 360)
    front_m = 3 / np.maximum(np.abs(np.cos(angles)), 1e-9)
    side_m = 2 / np.maximum(np.abs(np.sin(angles)), 1e-9)
    ranges_m = np.minimum(front_m, side_m)
    sweep_m = np.column_stack([ranges_m * np.cos(angles), ranges_m * np.sin(angles)])
    step = np.eye(4)
    step[0, 3] = 0.5
    later_m = sweep_m - step[:2, 3]
    drawing = Drawing.of([sweep_m, later_m], np.stack([np.eye(4), step]))
    without_later = np.array([False, True])
    field = Field.of(drawing.level_map(without_later))
    gatherer = Gatherer()
    gatherer.add(sweep_m, None)
    gatherer.add(later_m, step)
    LevelFixer().fix(field, gatherer.gathered(OVER_M))


def street() -> NDArray[np.float64]:
    """Points (n, 3) in metres of a made-up street: a ground, and houses on both sides."""
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-40, 40, (4000, 2)), rng.normal(0, 0.02, 4000)])
    parts = [ground]
    for x_m in range(-36, 36, 12):
        front = np.column_stack(
            [rng.uniform(x_m, x_m + 8, 400), np.full(400, 9.0), rng.uniform(0, 7, 400)]
        )
        side = np.column_stack(
            [np.full(400, float(x_m)), rng.uniform(9, 15, 400), rng.uniform(0, 7, 400)]
        )
        parts += [front, side, front * (1, -1, 1), side * (1, -1, 1)]
    turned = pose(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.3]]))[0]
    return transformed(turned, np.concatenate(parts))


def _decode_formats(points_m: NDArray[np.float64]) -> None:
    """Decode the points (n, 3) from the bytes of PointCloud2, KITTI and NCLT scans."""
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
