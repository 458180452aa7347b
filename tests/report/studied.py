"""Builds the artifacts of a small study of robustness.

It has four test days, two methods and a variant, turned queries, queries with new walls, a sequence
of stress, real changes and a second cell size.
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import store
from pipeline.core.schemas import Labels, ScanContextViews, SignatureViews
from pipeline.evaluation import results
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.evaluations import Evaluations
from pipeline.evaluation.events import Bands
from pipeline.evaluation.protocols import Distance
from pipeline.formats.changes import Change, write_changes
from pipeline.matching.rejection import NoveltyEvidence
from pipeline.perturbations import Case
from pipeline.report.study import StudyResults
from pipeline.studies import study as studies
from pipeline.studies.layout import Layout
from tests.artifacts import write_submaps, write_views, written
from tests.evaluation.made import BOOTSTRAP, LABELS, XY_M, standing
from tests.report.figures.made import TRAIN_PLACES, TRAIN_XY_M, evaluation
from tests.studies.made import study as made_study

TRAIN = "2012-01-15"
TESTS = {"2012-02-04": 20, "2012-03-17": 62, "2012-06-15": 152, "2012-10-28": 287}
REVERSED = "2012-07-01"
DAYS = {**TESTS, REVERSED: 168}
VIEWS: dict[str, tuple[Any, tuple[int, ...]]] = {
    "scan_context": (ScanContextViews, (40, 120)),
    "signature": (SignatureViews, (192,)),
}
"""What each view's artifact is, and the shape of one."""
TURNED = [Case(), *(Case("turned", repeat=repeat) for repeat in range(2))]
WALLS = [Case("construction", level, shadow) for level in (1.0, 2.0) for shadow in (False, True)]
FEW = 3
SETTINGS = made_study(
    **{
        "experiment": "robustness",
        "world": "campus_tiny",
        "reads": "simulated",
        "train": TRAIN,
        "tests": list(TESTS),
        "budget": "tiny",
        "submap": "single",
        "grids": ["10m"],
        "cells": ["5m"],
        "methods": [
            {"name": "sci", "view": "scan_context", "variants": {"4way": "method.n_way=4"}},
            {"name": "scan_context", "view": "scan_context"},
        ],
        "perturbed": {"turned": list(TESTS)[:2], "construction": list(TESTS)[:1]},
        "stress": {REVERSED: "all reversed"},
    }
)
KNOWN = {"entropy": np.array([0.1, 0.2]), "energy": np.array([1.0, 2.0])}
EVIDENCE = NoveltyEvidence(np.array([True, False]), KNOWN, KNOWN, np.arange(2))
LOSSES = {
    "curves/loss": np.array([2.0, 1.0]),
    "curves/validation_loss": np.array([3.0, 2.0]),
    "best_epoch": np.array(1),
}
WRONG = {"sci": (), "sci-4way": (1,), "scan_context": (0, 1), "m2dp": (0, 1)}
"""Which answers are misplaced besides those of SCI; turned, the last seen query's too, but for the
4-way model."""


def build(
    artifacts: Path,
    settings: studies.Study = SETTINGS,
    xy_m: np.ndarray = XY_M,
    misplaced: int = 4,
    **judged_as: Any,
) -> StudyResults:
    """Write everything that a report of the study reads, and return the study.

    The seven queries of a test day are taken at `xy_m`. From the third day on, and turned, the one
    numbered `misplaced` is placed wrong too. `judged_as` are fields of each Evaluation.
    """
    rng = np.random.default_rng(0)
    grids = [(grid.name, grid.name.removesuffix("m")) for grid in settings.all_grids]
    for sequence in (*settings.train, *settings.tests, *settings.stress):
        is_training = sequence in settings.train
        world_T_anchor = standing(TRAIN_XY_M if is_training else xy_m)
        n = len(world_T_anchor)
        write_submaps(artifacts / f"submaps/campus/{sequence}.zarr", world_T_anchor)
        for view in {method.view for method in settings.methods}:
            kind, shape = VIEWS[view]
            images = rng.uniform(0, 16, (n, *shape)).astype(np.float32)
            path = artifacts / f"views/campus/{view}/{sequence}.zarr"
            write_views(path, kind, images, world_T_anchor, cases=[asdict(Case())])
        ground_truth = {
            "places": TRAIN_PLACES if is_training else LABELS.places,
            "cells": np.arange(10),
            "oracle": np.zeros(n, int),
            "nearest_m": np.zeros(n),
            "nearest_turn_deg": np.zeros(n),
        }
        for grid, cell_m in grids:
            path = artifacts / f"labels/campus/{grid}/{sequence}.zarr"
            own = {"days": DAYS.get(sequence, 0), "x_m": [0, 100], "y_m": [0, 100]}
            written(path, Labels, ground_truth, cell_m=int(cell_m), **own)
    for method in settings.methods:
        for model, (grid, _) in product(method.models, grids):
            if model.variant and grid not in settings.grid_names:
                continue
            recipe = {
                "_target_": f"pipeline.methods.{method.name}.A",
                "view": method.view,
                "budget": "0.03",
                "n_way": "4" if model.variant else "1",
            }
            learned = EVIDENCE.arrays() | (LOSSES if method.name == "sci" else {})
            store.write_model(
                artifacts / f"train/campus/{grid}/{model.name}.zarr.zip", learned, recipe
            )
            stress = settings.stress if grid in settings.grid_names else ()
            for sequence in (*settings.tests, *stress):
                evaluations = judged(settings, model.name, sequence, xy_m, misplaced, judged_as)
                path = artifacts / f"evaluate/campus/{grid}/{model.name}/{sequence}.zarr"
                store.write(path, evaluations)
    (artifacts / "events/campus").mkdir(parents=True)
    for sequence in settings.tests:
        write_changes(
            artifacts / f"events/campus/{sequence}.csv", [Change("construction", 5, 10, 0.0, 5.0)]
        )
    layout = Layout(artifacts)
    table = results.ResultsTable(layout, settings, Ageing(), Bands((25.0, 50.0)), 0.2).table()
    (artifacts / "results/campus").mkdir(parents=True)
    table.to_csv(artifacts / "results/campus" / results.FILE, index=False)
    return StudyResults(layout, settings, "10m", results.read(layout, {"campus": settings}))


def judged(
    settings: studies.Study,
    model: str,
    sequence: str,
    xy_m: np.ndarray,
    misplaced: int,
    judged_as: Mapping[str, Any],
) -> Evaluations:
    """The evaluation of one model on one sequence in each of its cases."""
    days = DAYS[sequence]
    found = {}
    some = (
        WALLS if sequence in settings.perturbed.get("construction", ()) and "-" not in model else []
    )
    for case in [*TURNED, *some] if sequence in settings.perturbed["turned"] else TURNED[:1]:
        is_worse = (case.change and "-" not in model) or days > 100
        wrong = (*WRONG[model], *((misplaced,) if is_worse else ()))
        heading_deg = 5.0 if model == "scan_context" else np.nan
        judged_case = evaluation(days, wrong=wrong, heading_deg=heading_deg, xy_m=xy_m)
        found[case] = replace(judged_case, target_precision=0.9, **judged_as)
    return Evaluations(
        tuple(found.values()),
        [asdict(case) for case in found],
        sequence=sequence,
        train=settings.train_text,
        distance=asdict(Distance()),
        bootstrap=asdict(BOOTSTRAP),
    )
