"""Builds the artifacts of a small study of robustness.

It has four test days, two methods and a variant, turned queries, queries with new walls, a sequence
of stress, real changes and a second cell size.
"""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pipeline.alterations import Case
from pipeline.core import store
from pipeline.core.schemas import Labels, ScanContextViews
from pipeline.evaluation import results
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.events import Bands
from pipeline.evaluation.judgement import Evaluations
from pipeline.evaluation.protocols import Distance
from pipeline.formats.changes import Change, write_changes
from pipeline.matching.rejection import Evidence
from pipeline.report.study import Study
from pipeline.studies.layout import Layout
from tests.artifacts import write_submaps, write_views, written
from tests.report.figures.made import BOOTSTRAP, PLACES, TRAIN_PLACES, TRAIN_XY_M, evaluation
from tests.studies.made import study as made_study

TRAIN = "2012-01-15"
TESTS = {"2012-02-04": 20, "2012-03-17": 62, "2012-06-15": 152, "2012-10-28": 287}
REVERSED = "2012-07-01"
TURNED = [Case(), *(Case("turned", repeat=repeat) for repeat in range(2))]
WALLS = [Case("construction", level, shadow) for level in (1.0, 2.0) for shadow in (False, True)]
FEW = 3
SETTINGS = made_study(
    **{
        "question": "robustness",
        "world": "campus_tiny",
        "heeds": "simulated",
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
        "altered": {"turned": list(TESTS)[:2], "construction": list(TESTS)[:1]},
        "stress": {REVERSED: "all reversed"},
    }
)
KNOWN = {"entropy": np.array([0.1, 0.2]), "energy": np.array([1.0, 2.0])}
EVIDENCE = Evidence(np.array([True, False]), KNOWN, KNOWN, np.arange(2))
WRONG = {"sci": (), "sci-4way": (1,), "scan_context": (0, 1)}
"""Which answers are misplaced besides those of SCI; turned, the last seen query's too, but for the
4-way model."""


def build(artifacts: Path) -> Study:
    """Write everything that a report of the study reads, and return the study."""
    rng = np.random.default_rng(0)
    for sequence, days in {TRAIN: 0, **TESTS, REVERSED: 168}.items():
        xy_m = TRAIN_XY_M if sequence == TRAIN else evaluation().xy_m
        world_T_anchor = np.tile(np.eye(4), (len(xy_m), 1, 1))
        n = len(xy_m)
        world_T_anchor[:, :2, 3] = xy_m
        write_submaps(artifacts / f"submaps/campus/{sequence}.zarr", world_T_anchor)
        images = rng.uniform(0, 16, (n, 40, 120)).astype(np.float32)
        path = artifacts / f"views/campus/scan_context/{sequence}.zarr"
        write_views(path, ScanContextViews, images, world_T_anchor, cases=[asdict(Case())])
        truth = {
            "places": TRAIN_PLACES if sequence == TRAIN else PLACES,
            "cells": np.arange(10),
            "oracle": np.zeros(n, int),
        }
        truth |= {"nearest_m": np.zeros(n), "nearest_turn_deg": np.zeros(n)}
        for cell_m in (10, 5):
            own = {"days": days, "cell_m": cell_m, "x_m": [0, 100], "y_m": [0, 100]}
            written(artifacts / f"labels/campus/{cell_m}m/{sequence}.zarr", Labels, truth, **own)
        for model in WRONG if sequence != TRAIN else ():
            judged(
                artifacts / f"evaluate/campus/10m/{model}/{sequence}.zarr", model, sequence, days
            )
            if sequence in TESTS and "-" not in model:
                judged(
                    artifacts / f"evaluate/campus/5m/{model}/{sequence}.zarr", model, sequence, days
                )
    losses = {
        "curves/loss": np.array([2.0, 1.0]),
        "curves/held_out_loss": np.array([3.0, 2.0]),
        "best_epoch": np.array(1),
    }
    for method in SETTINGS.methods:
        for model in method.models:
            recipe = {
                "_target_": f"pipeline.methods.{method.name}.A",
                "view": "scan_context",
                "budget": "0.03",
                "n_way": "1",
            }
            recipe |= {"n_way": "4"} if model.variant else {}
            for grid in ("10m", *(["5m"] if not model.variant else [])):
                learned = EVIDENCE.arrays() | (losses if method.name == "sci" else {})
                store.write_model(
                    artifacts / f"train/campus/{grid}/{model.name}.zarr.zip", learned, recipe
                )
    (artifacts / "events/campus").mkdir(parents=True)
    for sequence in TESTS:
        write_changes(
            artifacts / f"events/campus/{sequence}.csv", [Change("construction", 5, 10, 0.0, 5.0)]
        )
    table = results.ResultsTable(
        Layout(artifacts), SETTINGS, Ageing(), Bands((25.0, 50.0)), 0.2
    ).table()
    (artifacts / "results/campus").mkdir(parents=True)
    table.to_csv(artifacts / "results/campus" / results.FILE, index=False)
    layout = Layout(artifacts)
    return Study(layout, SETTINGS, "10m", results.read(layout, {"campus": SETTINGS}))


def judged(path: Path, model: str, sequence: str, days: int) -> None:
    """Write the evaluation of one model on one sequence in each of its cases.

    From the third day on it places one more query wrong.
    """
    found = {}
    some = WALLS if sequence in SETTINGS.altered["construction"] and "-" not in model else []
    for case in [*TURNED, *some] if sequence in SETTINGS.altered["turned"] else TURNED[:1]:
        wrong = (*WRONG[model], *((4,) if (case.change and "-" not in model) or days > 100 else ()))
        judged_case = evaluation(
            days, wrong=wrong, heading_deg=5.0 if model == "scan_context" else np.nan
        )
        found[case] = replace(judged_case, wanted_precision=0.9)
    rules = {"distance": asdict(Distance()), "bootstrap": asdict(BOOTSTRAP)}
    own = {**rules, "sequence": sequence, "train": TRAIN}
    evaluations = Evaluations(tuple(found.values()), [asdict(case) for case in found], **own)
    store.write(path, evaluations)
