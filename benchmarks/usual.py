"""Learns the usual probabilities: `python -m benchmarks.usual CHAIN STUDY/GRID/MODEL …`.

Each CHAIN is a folder with conf/ and artifacts/ in which `dvc repro` ranked later days of a world.
Every EVERY-th query of each later day is searched for to the last round against the training day's
map. From all hypotheses together, with equal weight for each world, it learns the numbers of
`probabilities.USUAL`, which every site starts from. So USUAL has seen the worlds and days named
here; it must be tested on others.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.mapping.gathering import submap_points
from pipeline.posing.fix import features
from pipeline.posing.probabilities import FEATURES, USUAL, learned
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import OF_SCANS

EVERY = 5
SURE = 0.999
"""High, so that searches go on until perceptual aliases are among the hypotheses."""
WEIGHT = 100.0
"""Total weight of a world's queries, however many they are."""

Searched = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""The features (n, feature) of a query's hypotheses, and which are right (n,)."""


def searched(chain: Path, model: str) -> Iterator[Searched]:
    """Every EVERY-th query of the later days of a chain's world."""
    study = model.split("/")[0]
    with initialize_config_dir(str((chain / "conf").resolve()), version_base=None):
        fixer: Fixer = instantiate(compose("poses").fixer)
    artifacts = chain / "artifacts"
    (mapped,) = (artifacts / "map" / study).glob("*.zarr")
    targets = Targets.read(mapped)
    for path in sorted((artifacts / "localize" / model).glob("*.zarr")):
        ranking = store.read(path, schemas.Rankings)
        xy_m = ranking.load("xy_m").astype(np.float64)
        heading_deg = ranking.load("heading_deg").astype(np.float64)
        scans = store.read(artifacts / "scans" / study / path.name, schemas.Scans)
        submaps = store.read(artifacts / "submaps" / study / path.name, schemas.Submaps)
        world_T_true = submaps.load("world_T_anchor")
        for row in range(0, len(world_T_true), EVERY):
            points_m = next(iter(submap_points(scans, submaps, slice(row, row + 1))))
            answers = Answers(xy_m[row], heading_deg[row])
            fix = replace(fixer, sure=SURE).fix(points_m, targets, answers)
            if fix.hypotheses:
                poses = np.array([hypothesis.world_T_query for hypothesis in fix.hypotheses])
                good = OF_SCANS.right(poses, np.broadcast_to(world_T_true[row], poses.shape))
                yield features(fix.hypotheses), good


def main(*words: str) -> None:
    chains = list(zip(words[::2], words[1::2], strict=True))
    with Compute("processes") as compute:
        worlds = list(compute.each(lambda chain: list(searched(Path(chain[0]), chain[1])), chains))
    queries = [query for world in worlds for query in world]
    weight = np.concatenate([np.full(len(world), WEIGHT / len(world)) for world in worlds])
    usual = learned([query[0] for query in queries], [query[1] for query in queries], weight)
    print(f"{len(queries)} queries of {len(worlds)} worlds")
    for name, before, after in zip(FEATURES, USUAL.weights, usual.weights, strict=True):
        print(f"{name:<12}{before:8.1f} →{after:8.1f}")
    print(f"{'offset':<12}{USUAL.offset:8.1f} →{usual.offset:8.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
