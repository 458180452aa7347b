"""One study, gathered from its artifacts: every method on every test sequence at one cell size."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.protocols import Distance
from pipeline.reports import gallery, page, runs, series
from pipeline.reports.comparison import Against, against_first
from pipeline.reports.learned import Learned
from pipeline.reports.result import Result, by_method
from pipeline.tracking.runs import RunRecord


class Find(Protocol):
    """Where an artifact lies.

    `kind` is a stage (submaps, labels, views, train, evaluate) or metrics, the json beside a method's evaluations. Submaps and
    labels are of a sequence, models and metrics of a method, and views and evaluations of both.
    """

    def __call__(self, kind: str, sequence: str = "", method: str = "") -> Path: ...


def folders(artifacts: Path, dataset: str, grid: str, views: Mapping[str, str]) -> Find:
    """Where `dvc repro` leaves the artifacts of one data set and grid; `views` says what each method looks at."""

    def find(kind: str, sequence: str = "", method: str = "") -> Path:
        stage, within = {
            "submaps": ("submaps", f"{sequence}.zarr"),
            "labels": ("labels", f"{grid}/{sequence}.zarr"),
            "views": ("views", f"{views.get(method)}/{sequence}.zarr"),
            "train": ("train", f"{grid}/{method}.safetensors"),
            "evaluate": ("evaluate", f"{grid}/{method}/{sequence}.zarr"),
            "metrics": ("evaluate", f"{grid}/{method}.json"),
        }[kind]
        return artifacts / stage / dataset / within

    return find


@dataclass(frozen=True)
class Study:
    """What the report draws and MLflow shows."""

    dataset: str
    grid: str
    train: str
    simulated: bool
    results: Sequence[Result]
    models: Mapping[str, Learned]
    """By method."""
    train_xy_m: NDArray[np.float64]
    """(submap, 2) the training path."""
    train_places: NDArray[np.int64]
    """(submap,) the place of each."""
    cell_m: float
    find: Find
    """Where the views lie, which are opened only when they are drawn."""
    distance: Distance
    """What the evaluations were judged by."""
    bootstrap: Bootstrap

    @classmethod
    def gather(
        cls, find: Find, dataset: str, grid: str, train: str, tests: Sequence[str], methods: Sequence[str], simulated: bool
    ) -> Self:
        """Read a study's artifacts; raises ArtifactError for one that is not there."""
        models = {method: Learned.read(find("train", method=method)) for method in methods}
        results, rules = [], {}
        for method in methods:
            numbers = _metrics(find("metrics", method=method), tests)
            for sequence in tests:
                artifact = store.read(find("evaluate", sequence, method), schemas.EVALUATIONS)
                wanted = float(artifact.attrs["wanted_precision"])
                results.append(Result(method, sequence, numbers[sequence], Evaluation.read(artifact), wanted))
                rules = artifact.attrs
        track = store.read(find("submaps", train), schemas.SUBMAPS).load("world_T_anchor")[:, :2, 3]
        labels = store.read(find("labels", train), schemas.LABELS)
        places, cell_m = labels.load("places"), float(labels.attrs["cell_m"])
        judged = Distance(**rules["distance"]), Bootstrap(**rules["bootstrap"])
        return cls(dataset, grid, train, simulated, results, models, track, places, cell_m, find, *judged)

    @property
    def recipes(self) -> dict[str, Mapping[str, str]]:
        """Method to the parameters that its model was learned with."""
        return {method: model.recipe for method, model in self.models.items()}

    @cached_property
    def tested(self) -> list[Against]:
        """Each method against the first, on the same queries."""
        return against_first(self.results, self.bootstrap)

    def write(self, folder: Path) -> None:
        """Draw every figure and write report.md, results.txt and the plain data of two plots into `folder`."""
        folder.mkdir(parents=True)
        (folder / "report.md").write_text(page.report(self, gallery.draw(self, folder)))
        (folder / "results.txt").write_text(page.text(self))
        (folder / "year.csv").write_text(series.year(self.results, self.simulated))
        (folder / "precision_recall.csv").write_text(series.precision_recall(self.results, self.simulated))

    def runs(self, figures: Path, colours: Mapping[str, str]) -> list[RunRecord]:
        """A run a method, with its metrics over the days since training, and a child run a test sequence."""
        return [runs.record(self, method, group, figures, colours[method]) for method, group in by_method(self.results).items()]


def _metrics(path: Path, tests: Sequence[str]) -> dict[str, Any]:
    """Sequence to its numbers; raises ArtifactError unless the file holds every test sequence."""
    numbers: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
    if missing := [sequence for sequence in tests if sequence not in numbers]:
        raise ArtifactError(f"{path}: no numbers of {missing[0]}; `dvc repro` makes them")
    return numbers
