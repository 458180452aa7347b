"""One study, gathered from its artifacts: every method on every test sequence at one cell size."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.evaluation.judgement import Judgement
from pipeline.reports import maps, plots, tables
from pipeline.reports.page import Illustration, report
from pipeline.reports.result import Result, by_method
from pipeline.reports.style import save
from pipeline.tracking import RunRecord

CURVES = ("loss", "accuracy", "held_out_loss", "held_out_accuracy")


@dataclass(frozen=True)
class Study:
    """What the report draws and MLflow shows."""

    dataset: str
    grid: str
    train: str
    simulated: bool
    results: Sequence[Result]
    recipes: Mapping[str, Mapping[str, str]]
    """Method to the parameters that its model was learned with."""
    curves: Mapping[str, tuple[list[NDArray[np.float64]], int]]
    """Method to its training curves, in the order of `CURVES`, and the epoch that was kept; none for a method without epochs."""
    train_xy_m: NDArray[np.float64]
    """(submap, 2) the training path."""
    cell_m: float

    @classmethod
    def gather(
        cls, artifacts: Path, dataset: str, grid: str, train: str, tests: Sequence[str], methods: Sequence[str], simulated: bool
    ) -> "Study":
        """Read a study's artifacts; raises ArtifactError for one that is not there."""
        results, recipes, curves = [], {}, {}
        for method in methods:
            path = artifacts / "train" / dataset / grid / f"{method}.safetensors"
            model = store.read_model(path)
            recipes[method] = store.read_recipe(path)
            if "best_epoch" in model:
                curves[method] = ([model[f"curves/{name}"] for name in CURVES], int(model["best_epoch"]))
            folder = artifacts / "evaluate" / dataset / grid / method
            for sequence in tests:
                evaluation = store.read(folder / f"{sequence}.zarr", schemas.EVALUATIONS)
                judgement = Judgement(**{field.name: evaluation.load(field.name) for field in fields(Judgement)})
                numbers = json.loads((folder / f"{sequence}.json").read_text())
                results.append(Result(method, sequence, numbers, judgement))
        track = store.read(artifacts / "submaps" / dataset / f"{train}.zarr", schemas.SUBMAPS).load("world_T_anchor")[:, :2, 3]
        labels = store.read(artifacts / "labels" / dataset / grid / f"{train}.zarr", schemas.LABELS)
        return cls(dataset, grid, train, simulated, results, recipes, curves, track, float(labels.attrs["cell_m"]))

    def write(self, folder: Path) -> None:
        """Draw every figure and write report.md and results.txt into `folder`."""
        folder.mkdir(parents=True)
        figures = [
            Illustration("precision_recall", "precision_recall.svg", "Precision and recall (Fig. 6)"),
            Illustration("year", "year.svg", "AUC over the year (Fig. 8)"),
            Illustration("montage", "outcomes.svg", "Where queries were placed right and wrong"),
        ]
        save(plots.precision_recall(self.results, self.simulated), folder / figures[0].path)
        save(plots.year(self.results, self.train, self.simulated), folder / figures[1].path)
        save(maps.montage(self.results, self.train_xy_m, self.simulated), folder / figures[2].path)
        for result in self.results:
            name = f"outcomes_{result.method}_{result.sequence}.svg"
            save(maps.outcome_map(result, self.train_xy_m, self.simulated), folder / name)
            figures.append(Illustration("map", name, f"{result.method} on {result.label}"))
        for method, (curves, best) in self.curves.items():
            name = f"history_{method}.svg"
            loss, accuracy, held_out_loss, held_out_accuracy = curves
            figure = plots.history(loss, accuracy, held_out_loss, held_out_accuracy, best, method, self.simulated)
            save(figure, folder / name)
            figures.append(Illustration("history", name, f"How {method} was learned"))
        page = report(self.dataset, self.train, self.cell_m, self.recipes, self.results, figures, self.simulated)
        (folder / "report.md").write_text(page)
        (folder / "results.txt").write_text(self.table())

    def table(self) -> str:
        """The results for a terminal."""
        made = "simulated campus" if self.simulated else self.dataset
        head = f"{made}, trained on {self.train} alone, cells of {self.cell_m:g} m"
        return f"{head}\n\n{tables.outcomes(self.results).text()}"

    def runs(self, figures: Path, colours: Mapping[str, str]) -> list[RunRecord]:
        """A run a method, with its metrics over the days since training, and a child run a test sequence."""
        runs = []
        for method, group in by_method(self.results).items():
            tags = {"mlflow.runColor": colours[method], "dataset": self.dataset, "grid": self.grid, "method": method}
            tags["data"] = "simulated" if self.simulated else "recorded"
            params = {"dataset": self.dataset, "cell_m": self.cell_m, "train": self.train, **self.recipes[method]}
            series = {f"test/{name}": [(r.days, r.numbers[name]) for r in group] for name in group[0].numbers if name != "days"}
            if method in self.curves:
                curves, _ = self.curves[method]
                named = zip(CURVES, curves, strict=True)
                series |= {f"train/{name}": list(enumerate(column.tolist(), start=1)) for name, column in named}
            children = [
                RunRecord(
                    f"{method} {self.grid} {result.sequence}",
                    tags | {"sequence": result.sequence},
                    params | {"test": result.sequence},
                    _finite({f"test/{name}": [(result.days, value)] for name, value in result.numbers.items() if name != "days"}),
                    [figures / f"outcomes_{method}_{result.sequence}.svg"],
                )
                for result in group
            ]
            shared = [figures / name for name in ("precision_recall.svg", "year.svg", "outcomes.svg")]
            own = [figures / f"history_{method}.svg"] if method in self.curves else []
            runs.append(RunRecord(f"{method} {self.grid}", tags, params, _finite(series), shared + own, children))
        return runs


def _finite(series: Mapping[str, Sequence[tuple[int, float | None]]]) -> dict[str, list[tuple[int, float]]]:
    """Series without the points that have no number."""
    kept = {name: [(step, float(value)) for step, value in points if value is not None] for name, points in series.items()}
    return {name: points for name, points in kept.items() if points}
