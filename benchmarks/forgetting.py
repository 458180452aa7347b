"""How the octree's forgetting and its size change bird-views, on a training sequence alone.

`python -m benchmarks.forgetting ARTIFACTS VIEW STUDY/GRID/TRAIN …` draws the bird-views of a file
of conf/view in each of WAYS. *kept*: median share of the log-odds that is left from one scan to the
next. *light*, *lit*: mean brightness and share of the pixels that are not black. *right*: SAD's
held-out views whose place comes first, and its 95 % interval over held-out blocks. No test sequence
is read and nothing is trained.
"""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.frames import distance_and_turn
from pipeline.core.progress import Progress
from pipeline.evaluation.bootstrap import bounds
from pipeline.matching.ranking import Rows
from pipeline.matching.rejection import Evidence
from pipeline.views.birdview import BirdView
from pipeline.views.mapped import MappedViews, motion_variances
from stages import build

WAYS: Mapping[str, dict[str, Any]] = {
    "gaussian, constants": {"motion": "gaussian", "sigma": "constant"},
    "gaussian, the odometry's σ": {"motion": "gaussian", "sigma": "log"},
    "per_metre": {"motion": "per_metre"},
    "none": {"motion": "none"},
    "gaussian, 30 m": {"motion": "gaussian", "edge_m": 30.0},
    "gaussian, 50 m": {"motion": "gaussian", "edge_m": 50.0},
}
RESAMPLES = 1000


def rows(artifacts: Path, view: BirdView, training: str) -> Iterator[str]:
    """The rows of one training sequence, named STUDY/GRID/SEQUENCE."""
    study, grid, sequence = training.split("/")
    name = f"{sequence}.zarr"
    places = store.read(artifacts / "labels" / study / grid / name, schemas.Labels).load("places")
    scans = store.read(artifacts / "scans" / study / name, schemas.Scans)
    submaps = store.read(artifacts / "submaps" / study / name, schemas.Submaps)
    for way, changed in WAYS.items():
        drawn = replace(view, octree=replace(view.octree, **changed))
        images = np.stack(list(MappedViews(scans, submaps, drawn)))
        views = Rows(images, submaps.load("stamps_ns"), submaps.load("world_T_anchor"))
        evidence = Evidence.of(build("method", "sad").learn(views, places, Progress()))
        ahead = images[:, 0]
        cells = [f"{kept(scans, drawn):.3f}", f"{ahead.mean() / 255:.3f}"]
        cells += [f"{(ahead > 0).mean():.3f}", _right(evidence)]
        yield f"| {study} | {way} | {' | '.join(cells)} |"


def kept(scans: store.Artifact, view: BirdView) -> float:
    """The median share of the log-odds that is left from one scan to the next."""
    poses = scans.load("odom_T_scan")
    poses = poses if np.isfinite(poses).any() else scans.load("world_T_scan")
    moved_m, turned_deg = distance_and_turn(poses[:-1], poses[1:])
    said = motion_variances(scans.load("odom_variance"))[1:]
    motions = zip(moved_m, np.radians(turned_deg), said, strict=True)
    return float(np.nanmedian([view.octree.kept_share(*motion) for motion in motions]))


def _right(evidence: Evidence) -> str:
    count = evidence.block.max() + 1
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLES)
    counted = drawn[:, evidence.block]
    low, high = bounds(counted @ evidence.right / counted.sum(axis=1))
    return f"{evidence.right.mean():.3f} [{low:.2f}, {high:.2f}]"


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    print("| training | forgetting | kept | light | lit | right |\n|:--|:--|--:|--:|--:|--:|")
    for training in sys.argv[3:]:
        for line in rows(Path(sys.argv[1]), build("view", sys.argv[2]), training):
            print(line, flush=True)
