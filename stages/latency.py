"""Stage `latency`: measures the cost of a query on this machine, like the SCI paper's Table III.

It queries each method's model with submaps of one test sequence, on one thread, and times the
drawing of the view and the answer. It writes rows for the table of results, also with the cost of
training each model, and the time of each query.
"""

import os

os.environ.update(
    OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # before the imports below read them: a query is timed on one thread

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import schemas, store
from pipeline.core.building import build as build_method
from pipeline.core.building import parsed
from pipeline.core.replacing import write_text
from pipeline.core.settings import Count
from pipeline.evaluation.rows import table
from pipeline.evaluation.timing import Latency, TimedMethod, cost_rows
from pipeline.studies.models import ModelName
from stages import METHODS, build, stage


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/latency.yaml."""

    study: str
    simulated: bool
    cells: str
    """A file of conf/grid."""
    sequence: str
    """The test sequence whose submaps are the queries."""
    scans: Path
    submaps: Path
    models: Path
    """Folder of the models."""
    contenders: Mapping[str, str]
    """The models whose queries are timed, each with its view: a file of conf/view."""
    trained: tuple[ModelName, ...]
    """All models of the study, whose costs of training go into the table."""
    queries: Count
    """Number of the sequence's submaps that are queries."""
    k: Count
    """Number of places ranked for each query."""
    out: Path
    """File for the rows of results, a csv."""
    samples: Path
    """File for the time of each query, a json."""


@stage("latency")
def main(settings: Settings) -> str:
    name = f"{settings.sequence}.zarr"
    scans = store.read(settings.scans / name, schemas.Scans)
    submaps = store.read(settings.submaps / name, schemas.Submaps)
    views = {view: build("view", view) for view in dict.fromkeys(settings.contenders.values())}
    methods = {
        model: timed_method(view, views[view], settings.models / f"{model}{store.MODEL}")
        for model, view in settings.contenders.items()
    }
    latency = Latency.measure(methods, scans, submaps, settings.queries, settings.k)
    models = {model: settings.models / f"{model.name}{store.MODEL}" for model in settings.trained}
    common_columns = {
        "study": settings.study,
        "dataset": settings.study,
        "simulated": settings.simulated,
        "grid": settings.cells,
    }
    with store.replace(settings.out) as path:
        rows = [*latency.rows(), *cost_rows(models)]
        table(rows, **common_columns).to_csv(path, index=False)
    text = json.dumps({"sequence": settings.sequence, **latency.record()}, allow_nan=False)
    write_text(settings.samples, f"{text}\n")
    return latency.line()


def timed_method(view: str, draw: Any, path: Path) -> TimedMethod:
    """Load a stored model for timing, with a method that runs on one thread."""
    recipe = {name: parsed(value) for name, value in store.read_recipe(path).items()}
    method = build_method({**recipe, "threads": 1}, METHODS)
    model = store.read_model(path)
    describe = method.describer(model) if hasattr(method, "describer") else None
    return TimedMethod(view, draw, method.localizer(model), describe)


if __name__ == "__main__":
    main()
