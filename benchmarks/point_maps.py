"""How well scans are localised in a 3-D map that somebody else made: simulated, with known truth.

`python -m benchmarks.point_maps ARTIFACTS STUDY TRAIN DAY...` reads the scans that `dvc repro`
built. It makes a point-cloud map of the training day as people have them: all scans merged and
thinned, the ground cut off, every tenth building missing, and the whole tilted by 5°. Scans of the
later days are localised in it. A second map lacks the eastern half, so that scans there are off the
map. It prints for each day how many of the seen queries (training within 5 m) have a right pose
(2 m and 5°), and how many are accepted and wrong by the usual verdict, which is not calibrated.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import argparse
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.verdicts import SEEN_M, interval
from pipeline.core import schemas, store
from pipeline.core.frames import Poses, transformed
from pipeline.core.progress import Progress
from pipeline.mapping.gathering import submap_points
from pipeline.mapping.tiled_map import Thinning, TiledMap
from pipeline.online.map_pack import MapOptions, parts_of_map
from pipeline.online.site import Site
from pipeline.posing.verdict import OF_SCANS

VOXEL_M = 0.25
CUT_M = 0.3
"""Points of a scan below this height over its ground are cut off."""
TILT_DEG = 5.0
CELL_M = 2.0
TALL_M = 2.5
"""Cells whose points reach this high over the ground are of buildings, or of trees."""
LARGE_CELLS = 20
"""Connected cells, so many or more, are a building."""
EVERY_BUILDING = 10
PRECISIONS = (0.95, 0.99)


def main() -> None:
    """Print the tables of both maps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("artifacts", type=Path)
    parser.add_argument("study")
    parser.add_argument("train")
    parser.add_argument("days", nargs="+")
    parser.add_argument("--every", type=int, default=5, help="localise every EVERY-th scan")
    options = parser.parse_args()

    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_euler("x", TILT_DEG, degrees=True).as_matrix()
    start_s = time.process_time()
    merged_m, removed = map_points(options.artifacts, options.study, options.train)
    tilted_m = transformed(tilt, merged_m)
    is_west = merged_m[:, 0] < np.median(merged_m[:, 0])
    print(
        f"simulated: {len(merged_m):,} points, {removed} buildings removed, made in "
        f"{time.process_time() - start_s:.0f} CPU-s"
    )
    training = poses_of(options.artifacts, options.study, options.train)
    for name, points_m, is_half in (
        ("the whole map", tilted_m, False),
        ("its western half", tilted_m[is_west], True),
    ):
        start_s = time.process_time()
        site = Site(parts_of_map(tiled(points_m), "campus", {}, MapOptions(), Progress())[0])
        print(f"{name}: packed in {time.process_time() - start_s:.0f} CPU-s")
        in_map = KDTree(points_m[:, :2])
        for day in options.days:
            truth = poses_of(options.artifacts, options.study, day)[:: options.every]
            distance_m, _ = KDTree(training[:, :2, 3]).query(truth[:, :2, 3])
            world_T_query = tilt @ truth
            is_seen = np.asarray(distance_m < SEEN_M)
            if is_half:
                away_m, _ = in_map.query(world_T_query[:, :2, 3])
                is_seen = is_seen & np.asarray(away_m < 2 * SEEN_M)
            report(day, site, world_T_query, is_seen, points_of(options, day))


def report(
    day: str,
    site: Site,
    truth: Poses,
    is_seen: NDArray[np.bool_],
    scans: Iterable[NDArray[np.float64]],
) -> None:
    """Localise the scans of a day, and print its row."""
    poses = []
    accepted_at = []
    took_ms = []
    for points_m in scans:
        start_s = time.process_time()
        fix = site.localize(points_m, min(PRECISIONS))
        took_ms.append(1e3 * (time.process_time() - start_s))
        poses.append(fix.world_T_sensor)
        accepted_at.append(fix.accepted_at or 0.0)
    right = OF_SCANS.right(np.array(poses), truth)
    row = (
        f"  {day}: {len(truth)} queries, right {right[is_seen].mean():.3f} of {is_seen.sum()} seen"
    )
    for target_precision in PRECISIONS:
        is_accepted = np.array(accepted_at) >= target_precision
        wrong = int((is_accepted & ~right).sum())
        low, high = interval(wrong, int(is_accepted.sum()))
        row += (
            f"; at {target_precision} accepted {is_accepted.sum()}, wrong {wrong} "
            f"[{low:.3f}, {high:.3f}], off the map {int((is_accepted & ~is_seen).sum())}"
        )
    print(f"{row}; median {np.median(took_ms):.0f} CPU-ms")


def map_points(artifacts: Path, study: str, train: str) -> tuple[NDArray[np.float64], int]:
    """The merged points (n, 3) of a day without ground, and how many buildings are removed."""
    thinning = Thinning(VOXEL_M)
    for points_m, pose in zip(
        all_points(artifacts, study, train), poses_of(artifacts, study, train), strict=True
    ):
        thinning.add(transformed(pose, points_m[points_m[:, 2] > CUT_M]))
    merged_m = np.concatenate(list(thinning.tiled().tiles_m()))
    cells = np.floor(merged_m[:, :2] / CELL_M).astype(np.int64)
    cells -= cells.min(axis=0)
    lowest_m = np.full(cells.max(axis=0) + 1, np.inf)
    highest_m = np.full(lowest_m.shape, -np.inf)
    np.minimum.at(lowest_m, tuple(cells.T), merged_m[:, 2])
    np.maximum.at(highest_m, tuple(cells.T), merged_m[:, 2])
    ground_m = ndimage.minimum_filter(lowest_m, 15)
    number, _ = ndimage.label(highest_m - ground_m > TALL_M, np.ones((3, 3)))
    sizes = np.bincount(number.ravel())
    buildings = np.flatnonzero(sizes >= LARGE_CELLS)[1:]  # the first is everything else
    removed = buildings[::EVERY_BUILDING]
    return merged_m[~np.isin(number[tuple(cells.T)], removed)], len(removed)


def tiled(points_m: NDArray[np.float64]) -> TiledMap:
    """The map as `yearloc pack --map` thins it."""
    thinning = Thinning(MapOptions().voxel_m)
    thinning.add(points_m)
    return thinning.tiled()


def poses_of(artifacts: Path, study: str, day: str) -> Poses:
    """The true poses (n, 4, 4) of a day's submaps."""
    poses: Poses = store.read(artifacts / "submaps" / study / f"{day}.zarr", schemas.Submaps).load(
        "world_T_anchor"
    )
    return poses


def all_points(artifacts: Path, study: str, day: str) -> Iterable[NDArray[np.float64]]:
    """The points of each submap of a day, in its anchor's frame."""
    scans = store.read(artifacts / "scans" / study / f"{day}.zarr", schemas.Scans)
    submaps = store.read(artifacts / "submaps" / study / f"{day}.zarr", schemas.Submaps)
    return submap_points(scans, submaps, slice(0, len(submaps.load("stamps_ns"))))


def points_of(options: argparse.Namespace, day: str) -> Iterable[NDArray[np.float64]]:
    """The points of every EVERY-th submap of a day."""
    points = all_points(options.artifacts, options.study, day)
    return (part for row, part in enumerate(points) if row % options.every == 0)


if __name__ == "__main__":
    main()
