"""Scan Context's bins by the paper's text and by its authors' Matlab, on held-out blocks of
training.

`python -m benchmarks.bins ARTIFACTS STUDY/GRID/TRAIN …` draws both views of a training sequence
from its scans and submaps and has each method learn from either, with each seed. No test sequence
is read. *right*: held-out views whose place comes first; *AUC*: of precision over recall, each view
asked once more with its surroundings forgotten. Both are means over the seeds, with the lowest and
highest. A difference is the text's number minus the authors', with its 95 % interval over held-out
blocks. A method that draws nothing at random is trained once.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hydra import compose, initialize_config_dir
from numpy.typing import NDArray

from benchmarks.fullness import AUTHORS, PAPER
from pipeline.core import schemas, store
from pipeline.core.building import build
from pipeline.core.compute import Compute
from pipeline.core.progress import Progress
from pipeline.evaluation.bootstrap import bounds
from pipeline.evaluation.held_out import held_out_aucs
from pipeline.matching.ranking import Rows
from pipeline.matching.rejection import Evidence, Rejection
from pipeline.views.draw import Drawing
from stages import ROOT, within_budget

VIEWS = {"paper": PAPER, "authors": AUTHORS}
RESAMPLES = 1000
UNSEEN_SHARE = Rejection().unseen_share

Numbers = NDArray[np.float64]
"""Right and AUC (2, seed, resample + 1) of held-out views; blocks as they are come first."""


def rows(
    artifacts: Path, training: str, methods: Sequence[str], budget: str, seeds: Sequence[int]
) -> Iterator[str]:
    """The rows of one training sequence, named STUDY/GRID/SEQUENCE, two methods' views apart."""
    study, grid, sequence = training.split("/")
    name = f"{sequence}.zarr"
    places = store.read(artifacts / "labels" / study / grid / name, schemas.Labels).load("places")
    scans = store.read(artifacts / "scans" / study / name, schemas.Scans)
    submaps = store.read(artifacts / "submaps" / study / name, schemas.Submaps)
    views = {
        rule: Rows(
            np.concatenate(list(Drawing(scans, submaps, view).blocks(Compute(workers=1)))),
            submaps.load("stamps_ns"),
            submaps.load("world_T_anchor"),
        )
        for rule, view in VIEWS.items()
    }
    for method in methods:
        numbers = {
            rule: np.stack([_numbers(evidence) for evidence in evidences], axis=1)
            for rule, evidences in (
                (rule, learned(method, budget, seeds, seen, places)) for rule, seen in views.items()
            )
        }
        for rule, measured in numbers.items():
            cells = [_spread(number[:, 0]) for number in measured]
            yield f"| {study} | `{method}` | {rule} | {' | '.join(cells)} |"
        gained = (numbers["paper"] - numbers["authors"]).mean(axis=1)
        cells = [_interval(number) for number in gained]
        yield f"| {study} | `{method}` | difference | {' | '.join(cells)} |"


def learned(
    name: str, budget: str, seeds: Sequence[int], views: Rows, places: NDArray[np.int64]
) -> Iterator[Evidence]:
    """The held-out evidence of a method with each seed, trained as the stage `train` does.

    The name may be followed by settings, as on a command line.
    """
    with initialize_config_dir(str(ROOT / "conf"), version_base=None):
        words = [*f"method={name}".split(), f"budget={budget}"]
        cfg = within_budget(compose("train", words), words)
    method: Any = build(dict(cfg.method), ("pipeline.methods.",))
    is_random = hasattr(method, "seed")
    for seed in seeds if is_random else seeds[:1]:
        method = replace(method, seed=seed) if is_random else method
        yield Evidence.of(method.learn(views, places, Progress(float(cfg.budget.share))))


def _numbers(evidence: Evidence) -> Numbers:
    """Right and AUC (2, resample + 1); the blocks drawn follow from RESAMPLES alone."""
    count = evidence.block.max() + 1
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLES)
    counted = np.concatenate([np.ones((1, count)), drawn])[:, evidence.block]
    right = counted @ evidence.right / counted.sum(axis=1)
    own = next(iter(evidence.seen))
    return np.stack([right, held_out_aucs(evidence, own, UNSEEN_SHARE, counted)])


def _spread(values: NDArray[np.float64]) -> str:
    if len(values) == 1:
        return f"{values[0]:.3f}"
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f})"


def _interval(values: NDArray[np.float64]) -> str:
    low, high = bounds(values[1:])
    return f"{values[0]:+.3f} [{low:+.2f}, {high:+.2f}]"


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.bins", description=__doc__)
    parser.add_argument("artifacts", type=Path)
    parser.add_argument("training", nargs="+", metavar="STUDY/GRID/TRAIN")
    parser.add_argument(
        "--methods",
        default="scan_context,scan_context method.least_engaged=0.9,sci,sci_ring",
        help="files of conf/method, each with its changed settings behind it",
    )
    parser.add_argument("--budget", default="minutes", help="a file of conf/budget")
    parser.add_argument("--seeds", default="0,1,2")
    arguments = parser.parse_args()
    print("| training | method | bins | right | AUC |\n|:--|:--|:--|:--|:--|")
    for training in arguments.training:
        for line in rows(
            arguments.artifacts,
            training,
            arguments.methods.split(","),
            arguments.budget,
            [int(seed) for seed in arguments.seeds.split(",")],
        ):
            print(line, flush=True)
