"""A test sequence's submaps and the models of a study → what a query and a training cost on this
machine (SCI paper, Table III)."""

import os

os.environ.update(
    OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # heeded by what is imported from here on

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import schemas, store
from pipeline.core.building import build as build_plain
from pipeline.core.building import plain
from pipeline.core.settings import Count
from pipeline.evaluation.rows import table
from pipeline.evaluation.timing import Contender, Latency, cost_rows
from pipeline.studies.models import ModelName
from stages import build, stage

METHODS = ("pipeline.methods.",)
"""Where the classes of models lie."""


@dataclass(frozen=True)
class Settings:
    """What the stage is told."""

    study: str
    simulated: bool
    cells: str
    """A file of conf/grid."""
    sequence: str
    """Whose submaps are the queries."""
    scans: Path
    submaps: Path
    models: Path
    """Folder of the models."""
    contenders: Mapping[str, str]
    """The models that are asked, to what each looks at: a file of conf/view."""
    trained: tuple[ModelName, ...]
    """All models, whose training has a cost."""
    queries: Count
    k: Count
    """Places ranked for each query."""
    out: Path
    samples: Path
    """File for the time of each query."""


@stage("latency")
def main(settings: Settings) -> str:
    name = f"{settings.sequence}.zarr"
    scans = store.read(settings.scans / name, schemas.Scans)
    submaps = store.read(settings.submaps / name, schemas.Submaps)
    views = {view: build("view", view) for view in dict.fromkeys(settings.contenders.values())}
    contenders = {
        model: contender(view, views[view], settings.models / f"{model}{store.MODEL}")
        for model, view in settings.contenders.items()
    }
    measured = Latency.measure(contenders, scans, submaps, settings.queries, settings.k)
    trained = {model: settings.models / f"{model.name}{store.MODEL}" for model in settings.trained}
    common = {
        "study": settings.study,
        "dataset": settings.study,
        "simulated": settings.simulated,
        "grid": settings.cells,
    }
    with store.replace(settings.out) as path:
        table([*measured.rows(), *cost_rows(trained)], **common).to_csv(path, index=False)
    with store.replace(settings.samples) as path:
        text = json.dumps({"sequence": settings.sequence, **measured.record()}, allow_nan=False)
        path.write_text(f"{text}\n", encoding="utf-8")
    return measured.line()


def contender(view: str, draw: Any, path: Path) -> Contender:
    """A stored model asked by its method, on one thread where the method has threads."""
    recipe = {name: plain(value) for name, value in store.read_recipe(path).items()}
    method = build_plain({**recipe, "threads": 1}, METHODS)
    model = store.read_model(path)
    describe = method.describer(model) if hasattr(method, "describer") else None
    return Contender(view, draw, method.localizer(model), describe)


if __name__ == "__main__":
    main()
