"""One study, gathered from its artifacts: every method on every test sequence at one cell size."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.protocols import Distance
from pipeline.reports import gallery, page, runs, series
from pipeline.reports.result import Result, by_method
from pipeline.tracking import RunRecord


class Find(Protocol):
    """Where an artifact lies.

    `kind` is a stage (submaps, labels, views, train, evaluate) or metrics, the json beside an evaluation. Submaps and labels are
    of a sequence, a model is of a method, and views, evaluations and metrics are of both.
    """

    def __call__(self, kind: str, sequence: str = "", method: str = "") -> Path: ...


def folders(artifacts: Path, dataset: str, grid: str, views: Mapping[str, str]) -> Find:
    """Where `dvc repro` leaves the artifacts of one data set and grid; `views` says what each method looks at."""

    def find(kind: str, sequence: str = "", method: str = "") -> Path:
        stage, suffix = ("evaluate", "json") if kind == "metrics" else (kind, "safetensors" if kind == "train" else "zarr")
        within = {
            "submaps": sequence,
            "labels": f"{grid}/{sequence}",
            "views": f"{views.get(method)}/{sequence}",
            "train": f"{grid}/{method}",
            "evaluate": f"{grid}/{method}/{sequence}",
        }[stage]
        return artifacts / stage / dataset / f"{within}.{suffix}"

    return find


@dataclass(frozen=True)
class Learned:
    """What the report tells of a model."""

    recipe: Mapping[str, str]
    """The parameters that it was learned with."""
    curves: Mapping[str, NDArray[np.float64]]
    """Name to values (epoch,); none for a method without epochs."""
    best_epoch: int | None
    """The epoch that was kept, 0-based."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """From the file that training left."""
        model = store.read_model(path)
        curves = {name.removeprefix("curves/"): model[name] for name in sorted(model) if name.startswith("curves/")}
        return cls(store.read_recipe(path), curves, int(model["best_epoch"]) if "best_epoch" in model else None)


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
        for method, sequence in product(methods, tests):
            artifact = store.read(find("evaluate", sequence, method), schemas.EVALUATIONS)
            numbers = json.loads(find("metrics", sequence, method).read_text())
            wanted = float(artifact.attrs["wanted_precision"])
            results.append(Result(method, sequence, numbers, Evaluation.read(artifact), wanted))
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

    def write(self, folder: Path) -> None:
        """Draw every figure and write report.md, results.txt and the plain data of two plots into `folder`."""
        folder.mkdir(parents=True)
        figures = gallery.draw(self, folder)
        told = page.report(
            self.dataset,
            self.train,
            self.cell_m,
            self.recipes,
            self.results,
            figures,
            self.simulated,
            self.distance,
            self.bootstrap,
        )
        (folder / "report.md").write_text(told)
        (folder / "results.txt").write_text(self.table())
        (folder / "year.csv").write_text(series.year(self.results, self.simulated))
        (folder / "precision_recall.csv").write_text(series.precision_recall(self.results, self.simulated))

    def table(self) -> str:
        """The results for a terminal."""
        made = f"simulated {self.dataset}" if self.simulated else self.dataset
        head = f"{made}, trained on {self.train} alone, cells of {self.cell_m:g} m"
        return page.text(head, self.results, self.cell_m, self.distance)

    def runs(self, figures: Path, colours: Mapping[str, str]) -> list[RunRecord]:
        """A run a method, with its metrics over the days since training, and a child run a test sequence."""
        return [runs.record(self, method, group, figures, colours[method]) for method, group in by_method(self.results).items()]
