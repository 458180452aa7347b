"""What a prior saves and changes: `python -m benchmarks.priors CHAIN STUDY/GRID/MODEL`.

CHAIN is a folder with conf/ and artifacts/ in which `dvc repro` posed later days of a world. Every
EVERY-th query is localised three times: without a prior, with a prior near its true position
(Gaussian, SIGMA_M along each axis), and with a wrong one, somewhere on the training path FAR_M or
more away. If no pose is accepted within a prior, the whole map is searched, as `localize` does.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from pipeline.core import schemas, store
from pipeline.mapping.gathering import submap_points
from pipeline.posing.learned_verdict import VERDICT, Learned
from pipeline.posing.prior import Prior
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import OF_SCANS

EVERY = 15
SIGMA_M = 3.0
FAR_M = 80.0
SEEN_M = 5.0
TARGET_PRECISION = 0.99


def main(chain: str, model: str) -> None:
    artifacts = Path(chain) / "artifacts"
    study = model.split("/")[0]
    with initialize_config_dir(str((Path(chain) / "conf").resolve()), version_base=None):
        fixer: Fixer = instantiate(compose("poses").fixer)
    verdict_path = artifacts / "poses" / model / f"{VERDICT}.zarr"
    learned = Learned.read(verdict_path, store.read(verdict_path, schemas.Verdicts).basis)
    assert learned is not None
    fixer = learned.tuned(fixer)
    threshold = learned.verdict.thresholds[TARGET_PRECISION][0]
    (mapped,) = (artifacts / "map" / study).glob("*.zarr")
    targets = Targets.read(mapped)
    anchors_m = targets.world_T_anchor[:, :2, 3]
    rng = np.random.default_rng(0)
    rows = defaultdict[tuple[str, str], list[tuple[float, bool, bool]]](list)
    for path in sorted((artifacts / "localize" / model).glob("*.zarr")):
        ranking = store.read(path, schemas.Rankings)
        scans = store.read(artifacts / "scans" / study / path.name, schemas.Scans)
        submaps = store.read(artifacts / "submaps" / study / path.name, schemas.Submaps)
        world_T_true = submaps.load("world_T_anchor")
        for row in range(0, len(world_T_true), EVERY):
            points_m = next(iter(submap_points(scans, submaps, slice(row, row + 1))))
            answers = Answers.of(ranking.ranking(), row)
            away_m = np.linalg.norm(anchors_m - world_T_true[row, :2, 3], axis=1)
            place = "seen" if away_m.min() < SEEN_M else "unseen"
            x_m, y_m = (world_T_true[row, :2, 3] + rng.normal(0, SIGMA_M, 2)).tolist()
            wrong_x_m, wrong_y_m = rng.choice(anchors_m[away_m > FAR_M]).tolist()
            priors = {
                "none": None,
                "right": Prior.at(x_m, y_m, sigma_m=SIGMA_M),
                "wrong": Prior.at(wrong_x_m, wrong_y_m, sigma_m=SIGMA_M),
            }
            for name, prior in priors.items():
                start = time.process_time()
                for tried in (prior, None) if prior else (None,):
                    fix = fixer.fix(points_m, targets, answers, prior=tried)
                    is_accepted = learned.judge.error_probabilities(fix)[0] < threshold
                    if is_accepted:
                        break
                took_ms = 1e3 * (time.process_time() - start)
                is_right = bool(OF_SCANS.right(fix.pose[None], world_T_true[row][None])[0])
                rows[place, name].append((took_ms, is_right, bool(is_accepted)))
    for (place, name), found in sorted(rows.items()):
        took_ms, is_right, is_accepted = np.array(found).T
        is_right, is_accepted = is_right.astype(bool), is_accepted.astype(bool)
        print(
            f"{place:<7} prior {name:<6} {len(found):>4} queries, CPU-ms median "
            f"{np.median(took_ms):.0f}, 95 % {np.quantile(took_ms, 0.95):.0f}; right "
            f"{is_right.mean():.3f}; accepted right {(is_accepted & is_right).sum()}, wrong "
            f"{(is_accepted & ~is_right).sum()}"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
