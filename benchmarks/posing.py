"""Poses of one test day by peers, from the same candidates: `python -m benchmarks.posing campus
sci_ring 2013-04-05 [every]`.

It reads artifacts that `dvc repro` built of a study with poses. Everyone gets the ranking's first
five candidates, only "yearloc" may go on to others and to the whole map; the three that need a
first guess get the matches of walls. Peers take the candidate of the most inliers, as their own
programs do; KISS-Matcher (`pip install .[kiss]`) is skipped where it is not installed. One thread,
CPU time a query, from points to pose.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import small_gicp
from hydra.utils import instantiate
from numpy.typing import NDArray
from omegaconf import OmegaConf

from pipeline.core import schemas, store
from pipeline.core.frames import Poses, distance_and_turn, pose
from pipeline.mapping.gathering import submap_points
from pipeline.posing.fix import poses
from pipeline.posing.registration import Points
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets

VOXEL_M = 0.5
REACHES_M = (4.0, 1.0)
Peer = Callable[[Points, NDArray[np.float64]], NDArray[np.float64]]
"""Points (n, 3) of a query and its candidates (k, 2) → world_T_query (4, 4), NaN without one."""


def peers(fixer: Fixer, targets: Targets) -> dict[str, Peer]:
    """Each by its name."""

    def ours(fixer: Fixer) -> Peer:
        return lambda points_m, answers_m: poses(
            [fixer.fix(points_m, targets, Answers(answers_m, np.full(len(answers_m), np.nan)))]
        )[0]

    def icp(kind: str) -> Peer:
        def align(points_m: Points, answers_m: NDArray[np.float64]) -> NDArray[np.float64]:
            source = small_gicp.preprocess_points(points_m, VOXEL_M, 10)[0]
            turned = fixer.walls.cells_at_headings(fixer.walls.of(points_m))
            best = np.eye(4)
            most = -1
            for row in _rows(targets, answers_m):
                cloud = targets.cloud(fixer.registration, row)
                found = fixer.walls.match(targets.chart(fixer.walls, row), turned).target_T_query
                for reach_m in REACHES_M:
                    result = small_gicp.align(
                        cloud.points,
                        source,
                        cloud.tree,
                        found,
                        registration_type=kind,
                        max_correspondence_distance=reach_m,
                    )
                    found = result.T_target_source
                if result.num_inliers > most:
                    best = targets.world_T_anchor[row] @ found
                    most = result.num_inliers
            return best

        return align

    kinds = {"ICP, point to point": "ICP", "ICP, point to plane": "PLANE_ICP", "GICP": "GICP"}
    return {
        "yearloc": ours(fixer),
        "yearloc, one round": ours(replace(fixer, rounds=(5,))),
        **{name: icp(kind) for name, kind in kinds.items()},
        **_kiss(fixer, targets),
    }


def _kiss(fixer: Fixer, targets: Targets) -> dict[str, Peer]:
    """KISS-Matcher at 1 m voxels, which needs no first guess."""
    try:
        import kiss_matcher
    except ImportError:
        return {}

    def align(points_m: Points, answers_m: NDArray[np.float64]) -> NDArray[np.float64]:
        source = fixer.registration.prepare(points_m).xyz_m.astype(np.float32)
        best = np.eye(4)
        most = -1
        for row in _rows(targets, answers_m):
            matcher = kiss_matcher.KISSMatcher(1.0)
            found = np.eye(4)
            result = matcher.estimate(list(source), list(targets.points_m(row).astype(np.float32)))
            found[:3, :3] = result.rotation
            found[:3, 3] = np.ravel(result.translation)
            if matcher.get_num_final_inliers() > most:
                best = targets.world_T_anchor[row] @ found
                most = matcher.get_num_final_inliers()
        return best

    return {"KISS-Matcher": align}


def _rows(targets: Targets, answers_m: NDArray[np.float64]) -> Iterator[int]:
    return islice(
        targets.spaced(targets.nearest(answers_m, np.zeros(len(targets.world_T_anchor), bool))), 5
    )


def line(name: str, found: Poses, true: Poses, took_ms: list[float]) -> str:
    """A row of the table."""
    away_m, turn_deg = distance_and_turn(found, true)
    field, fine = (
        (away_m < far_m) & (turn_deg < far_deg) for far_m, far_deg in ((2.0, 5.0), (0.5, 2.0))
    )
    times = (
        f"{np.median(took_ms):8.1f} {np.percentile(took_ms, 95):8.1f}" if took_ms else f"{'':17}"
    )
    return (
        f"  {name:<22} {field.mean():8.3f} {fine.mean():8.3f} {np.nanmedian(away_m):8.3f} m {times}"
    )


def main(dataset: str, model: str, sequence: str, every: str = "6") -> None:
    """Print a row a peer, of every so many queries that training saw."""
    (path,) = Path("artifacts/map", dataset).glob("*.zarr")
    fixer = instantiate(OmegaConf.load("conf/poses.yaml").fixer)
    rankings = store.read(
        Path("artifacts/localize", dataset, "10m", model, f"{sequence}.zarr"), schemas.Rankings
    )
    root = Path("artifacts")
    scans = store.read(root / "scans" / dataset / f"{sequence}.zarr", schemas.Scans)
    submaps = store.read(root / "submaps" / dataset / f"{sequence}.zarr", schemas.Submaps)
    targets = Targets.read(path)
    world_T_true = submaps.load("world_T_anchor")
    answers_m = rankings.load("xy_m")
    away_m = np.linalg.norm(
        world_T_true[:, None, :2, 3] - targets.world_T_anchor[:, :2, 3], axis=2
    ).min(axis=1)
    rows = [int(row) for row in np.arange(0, len(world_T_true), int(every)) if away_m[row] < 5]
    clouds = {row: next(iter(submap_points(scans, submaps, slice(row, row + 1)))) for row in rows}
    print(
        f"{dataset} {sequence}, {model}: {len(rows)} queries\n  {'':<22}  2 m/5° .5 m/2°    error  "
        "  median ms   95 %"
    )
    for name, align in peers(fixer, targets).items():
        for row in rows[:: max(1, len(rows) // 8)]:
            align(clouds[row], answers_m[row])  # compile and fill caches
        found = []
        took = []
        for row in rows:
            start = time.process_time()
            found.append(align(clouds[row], answers_m[row]))
            took.append(1e3 * (time.process_time() - start))
        print(line(name, np.array(found), world_T_true[rows], took), flush=True)
    if np.isfinite(heading_deg := rankings.load("heading_deg")[rows, 0]).any():
        turn = np.column_stack([np.zeros((len(rows), 2)), np.deg2rad(heading_deg)])
        place = np.column_stack([answers_m[rows, 0], world_T_true[rows, 2, 3]])
        print(line(f"{model} itself", pose(place, turn), world_T_true[rows], []))


if __name__ == "__main__":
    main(*sys.argv[1:])
