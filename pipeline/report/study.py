"""One study as a report sees it: its rows of the table of results, and the artifacts whose arrays are drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.errors import InputError
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.protocols import Distance
from pipeline.report.learned import Learned
from pipeline.report.table import average
from pipeline.store import Artifact
from pipeline.studies.expansion import ModelName, models_of

Numbers = Mapping[tuple[str, str], tuple[float, float, float]]
"""Protocol and number to value, lowest and highest."""


@dataclass(frozen=True)
class Result:
    """One model on one test sequence as it was driven."""

    model: str
    """Such as sci or scan_context-engaged."""
    sequence: str
    """The test sequence, named by its date."""
    days: int
    """Whole days since the training sequence."""
    evaluation: Evaluation
    wanted_precision: float
    """What the thresholds were chosen for, on held-out blocks of training."""
    numbers: Numbers

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{self.sequence[:10]}, {self.days:+d} d"

    def number(self, protocol: str, name: str) -> float:
        """One number by one protocol; NaN where there is none."""
        return self.numbers.get((protocol, name), (np.nan,))[0]

    def interval(self, protocol: str, name: str) -> tuple[float, float] | None:
        """Its 95 % interval, lowest and highest; None where there is none."""
        _, low, high = self.numbers.get((protocol, name), (np.nan, np.nan, np.nan))
        return (low, high) if low <= high else None


def some(results: Sequence[Result]) -> Sequence[Result]:
    """The results, of which a figure needs one at least."""
    if not results:
        raise InputError("a figure needs at least one result")
    return results


def against(rows: pd.DataFrame, protocol: str) -> pd.DataFrame:
    """The rows of paired tests by one protocol, with the column `model`."""
    own = rows[(rows["change"] == "against") & (rows["protocol"] == protocol)]
    return own.assign(model=[ModelName(*names).name for names in zip(own["method"], own["variant"], strict=True)])


def by_model(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results of each model in the order of their days; models in the order they come."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.model, []).append(result)
    return {model: sorted(group, key=lambda one: (one.days, one.sequence)) for model, group in groups.items()}


def by_sequence(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results on each test sequence, in the order of its days; models in the order they come."""
    groups: dict[str, list[Result]] = {}
    for result in sorted(results, key=lambda one: (one.days, one.sequence)):
        groups.setdefault(result.sequence, []).append(result)
    return groups


def dates(results: Sequence[Result]) -> dict[str, str]:
    """Each sequence's name without its time of day, unless two were driven on one day."""
    names = list(by_sequence(results))
    return {name: name[:10] if len({name[:10] for name in names}) == len(names) else name for name in names}


@dataclass(frozen=True)
class Study:
    """A study at one of its own cell sizes."""

    artifacts: Path
    name: str
    words: Mapping[str, Any]
    """Of conf/studies.yaml."""
    grid: str
    table: pd.DataFrame
    """All rows of the study, those of other grids too."""

    @property
    def train(self) -> str:
        """The training sequence, or several with blanks between."""
        return str(self.words["train"])

    @property
    def simulated(self) -> bool:
        """Whether a world was simulated."""
        return bool(self.words["heeds"] == "simulated")

    @property
    def where(self) -> str:
        """`simulated campus`."""
        return f"{'simulated ' * self.simulated}{self.name}"

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of its own grid."""
        return self.table[self.table["grid"] == self.grid]

    @cached_property
    def families(self) -> list[str]:
        """The models that the year is reported of: each method's own, and in a study of the year its variants."""
        every = [model for method in self.words["methods"] for model in models_of(method) if not model.seed]
        return [model.name for model in every if not model.variant or self.words["question"] == "year"]

    @cached_property
    def models(self) -> dict[str, Learned]:
        """Of each of those."""
        return {name: Learned.read(self.find("train", model=name)) for name in self.families}

    @cached_property
    def trained(self) -> dict[str, Path]:
        """The file of every model of the study, variants and seeds too."""
        names = [model.name for method in self.words["methods"] for model in models_of(method)]
        return {name: self.find("train", model=name) for name in names}

    def recipe(self, model: str) -> Mapping[str, str]:
        """The parameters that a model was trained with."""
        return store.read_recipe(self.find("train", model=model))

    @cached_property
    def results(self) -> list[Result]:
        """Each of the families on each test sequence."""
        driven = self.rows[(self.rows["change"] == "") & (self.rows["kind"] == "") & (self.rows["seed"] == 0)]
        known: dict[tuple[str, str], dict[tuple[str, str], tuple[float, float, float]]] = {}
        columns = ("method", "variant", "sequence", "protocol", "number", "value", "low", "high")
        for method, variant, sequence, protocol, number, *values in driven[[*columns]].itertuples(index=False):
            known.setdefault((ModelName(method, variant).name, sequence), {})[protocol, number] = tuple(values)
        found = []
        for model in self.families:
            for sequence in self.words["tests"]:
                artifact = self.artifact("evaluate", sequence, model)
                evaluation, wanted = Evaluation.read(artifact), float(artifact.attrs["wanted_precision"])
                found.append(Result(model, sequence, evaluation.days, evaluation, wanted, known[model, sequence]))
        return sorted(found, key=lambda one: (self.families.index(one.model), one.days, one.sequence))

    @property
    def best(self) -> str:
        """The model that places most queries right by distance, on average over the test sequences."""
        return self.ranked[0]

    @cached_property
    def ranked(self) -> list[str]:
        """The models, those that place most right first."""
        groups = by_model(self.results).items()
        means = {model: average([one.number("distance", "recall_at_1") for one in group]) for model, group in groups}
        return sorted(means, key=lambda model: -np.nan_to_num(means[model], nan=-1.0))

    @cached_property
    def train_xy_m(self) -> NDArray[np.float64]:
        """The training path (n, 2)."""
        poses = [self.artifact("submaps", one).load("world_T_anchor") for one in self.train.split()]
        return np.asarray(np.concatenate(poses)[:, :2, 3], np.float64)

    @cached_property
    def labels(self) -> Artifact:
        """Of the training sequence."""
        return self.artifact("labels", self.train.split()[0])

    @property
    def cell_m(self) -> float:
        """The side of a cell."""
        return float(self.labels.attrs["cell_m"])

    @cached_property
    def distance(self) -> Distance:
        """What the evaluations were judged by."""
        return Distance(**self.artifact("evaluate", self.words["tests"][0], self.families[0]).attrs["distance"])

    @cached_property
    def bootstrap(self) -> Bootstrap:
        """How their intervals were computed."""
        return Bootstrap(**self.artifact("evaluate", self.words["tests"][0], self.families[0]).attrs["bootstrap"])

    def find(self, kind: str, sequence: str = "", model: str = "") -> Path:
        """Where an artifact lies: scans, submaps and labels are of a sequence, models of a model, the others of both."""
        views = {name.name: method["view"] for method in self.words["methods"] for name in models_of(method)}
        within = {
            "labels": f"{self.grid}/{sequence}.zarr",
            "views": f"{views.get(model, '')}/{sequence}.zarr",
            "train": f"{self.grid}/{model}.safetensors",
        }.get(kind, f"{self.grid}/{model}/{sequence}.zarr" if model else f"{sequence}.zarr")
        return self.artifacts / kind / self.name / within

    def artifact(self, kind: str, sequence: str = "", model: str = "") -> Artifact:
        """The artifact itself; raises ArtifactError where it is not there."""
        return store.read(self.find(kind, sequence, model), *(schema for schema in schemas.ALL))

    def source(self, kind: str, sequence: str = "", model: str = "") -> str:
        """Its path as dvc.lock names it."""
        return self.find(kind, sequence, model).relative_to(self.artifacts.parent).as_posix()
