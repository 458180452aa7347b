"""Builds the artifacts of a small study of learning further days.

It has two methods, two seeds of the first one, and five queries whose numbers are set by hand.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.schemas import Lifelong
from pipeline.evaluation import results
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.events import Bands
from pipeline.report.study import StudyResults
from pipeline.studies.layout import Layout
from tests.artifacts import write_submaps, written
from tests.evaluation.made import standing
from tests.report.figures.made import TRAIN_XY_M
from tests.studies.made import study as made_study

TRAIN = "2012-01-15"
LEARNED = "2012-03-17"
UPDATE = "2013-03-16"
QUERIED = ["2012-02-04", "2013-03-23"]
SETTINGS = made_study(
    **{
        "experiment": "lifelong",
        "source": "world",
        "world": "campus_tiny",
        "reads": "simulated",
        "train": TRAIN,
        "tests": QUERIED,
        "learned": [LEARNED],
        "self_training": [UPDATE],
        "budget": "tiny",
        "grids": ["10m"],
        "methods": [
            {
                "name": "sci",
                "view": "scan_context",
                "seeds": 2,
                "courses": {
                    "days": ["frozen", "incremental", "fine_tuned", "joint"],
                    "streets": ["incremental"],
                    "self_training": ["self_trained", "self_trained_all"],
                },
            },
            {
                "name": "sad",
                "view": "birdview",
                "stage": "birdviews",
                "courses": {"days": ["frozen", "incremental"], "streets": ["incremental"]},
            },
        ],
    }
)
DAY_NS = 86_400 * 10**9
DAY = np.array([0, 0, 1, 1, 1])
KNOWN_FROM = np.array([0, 0, 0, 1, -1])
"""Of five queries; the place of the last one is never known."""
RIGHT = {
    "frozen": [1, 0, 1, 0, 0],
    "incremental": [1, 1, 1, 1, 0],
    "fine_tuned": [0, 0, 1, 1, 0],
    "joint": [1, 1, 1, 1, 0],
}
RIGHT |= {"self_trained": [1, 1, 1, 0, 0], "self_trained_all": [1, 0, 0, 0, 0]}
"""After the last step; after the first all are like `frozen`.

The second seed of `fine_tuned` gets the first query right too.
"""


def build(artifacts: Path) -> StudyResults:
    """Write everything that a report of the study reads, and return the study."""
    write_submaps(artifacts / f"submaps/campus/{TRAIN}.zarr", standing(TRAIN_XY_M))
    for method in SETTINGS.methods:
        for model in method.models:
            place = {
                "study": "campus",
                "dataset": "campus",
                "simulated": True,
                "grid": "10m",
                **model.columns,
            }
            for order, strategies in method.courses.items():
                for strategy in strategies:
                    path = artifacts / f"lifelong/campus/10m/{model.name}/{order}-{strategy}.zarr"
                    attrs = course(path, order, strategy, model.seed)
                    path.with_suffix(".json").write_text(
                        json.dumps({"place": place, **attrs, "cpu_s": [100.0, 2.0]})
                    )
    table = results.ResultsTable(Layout(artifacts), SETTINGS, Ageing(), Bands((25.0,)), 0.2).table()
    (artifacts / "results/campus").mkdir(parents=True)
    table.to_csv(artifacts / "results/campus" / results.FILE, index=False)
    layout = Layout(artifacts)
    return StudyResults(layout, SETTINGS, "10m", results.read(layout, {"campus": SETTINGS}))


def course(path: Path, order: str, strategy: str, seed: int = 0) -> dict[str, Any]:
    """Write the artifact of one strategy in one order; returns its attributes."""
    right = np.array([RIGHT["frozen"], RIGHT[strategy]], bool)
    right[1, 0] |= strategy == "fine_tuned" and seed == 1
    names = {
        "days": [TRAIN, LEARNED],
        "streets": [f"{TRAIN} 1/2", f"{TRAIN} 2/2"],
        "self_training": [TRAIN, UPDATE],
    }[order]
    wrong = {"self_trained": 0, "self_trained_all": 3 + seed}.get(strategy)
    counts = (
        {}
        if wrong is None
        else {"queried": 50, "pseudo_labelled": 40 + wrong, "wrong": wrong, "changed": 7}
    )
    attrs = {
        "correct_m": 15.0,
        "order": order,
        "strategy": strategy,
        "queried": QUERIED,
        "steps": names,
        "places": [3, 4],
        "bytes": [2e6, 3e6],
    }
    attrs["counts"] = [{}, counts]
    attrs |= {"learned_ns": [20 * DAY_NS, 40 * DAY_NS], "queried_ns": [10 * DAY_NS, 50 * DAY_NS]}
    arrays = {
        "right": right,
        "error_m": np.where(right, 1.0, 20.0),
        "known_from": KNOWN_FROM,
        "day": DAY,
    }
    arrays["xy_m"] = np.stack([10.0 * np.arange(5), np.zeros(5)], axis=1)
    arrays |= {
        "place_xy_m": np.stack([10.0 * np.arange(4), np.zeros(4)], axis=1),
        "newest_ns": np.array([10, 40, 40, 20]) * DAY_NS,
    }
    written(path, Lifelong, arrays, **attrs)
    return attrs
