"""One study at one cell size: its rows of the table of results, and its artifacts.

Every section of a report is made from a `StudyResults`. It reads each artifact when it is needed,
and knows where it lies.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ArtifactError
from pipeline.core.schemas import Labels, Submaps
from pipeline.core.store import A
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.evaluations import Evaluations
from pipeline.evaluation.protocols import Distance
from pipeline.evaluation.rows import AGAINST, STRESS, UNPERTURBED, pick
from pipeline.mapping.from_above import Drive, Footprint, along
from pipeline.report.result import Result, by_model, ranked, read_scores
from pipeline.studies import study as studies
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName


@dataclass(frozen=True)
class TrainingRecord:
    """How a model was trained, read from its file."""

    recipe: Mapping[str, str]  # the parameters that it was trained with
    # names to values (round,); after each round the model is tried on validation blocks
    curves: Mapping[str, NDArray[np.float64]]
    best_round: int | None  # whose model was kept, from 0; None if the file does not say
    megabytes: float

    @property
    def rounds(self) -> int:
        """The number of training rounds; 0 for a method that learns nothing."""
        return max(map(len, self.curves.values()), default=0)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the record from a model's file."""
        with store.open_model(path) as model:
            curves = {
                name.removeprefix("curves/"): np.asarray(model[name][...])
                for name in sorted(model)
                if name.startswith("curves/")
            }
            best_round = int(model["best_epoch"][...]) if "best_epoch" in model else None
            megabytes = sum(array.nbytes for array in model.values()) / 1e6
        return cls(store.read_recipe(path), curves, best_round, megabytes)


def against(rows: pd.DataFrame, protocol: str) -> pd.DataFrame:
    """The rows of paired tests by one protocol."""
    return pick(rows, ask=AGAINST, protocol=protocol)


@dataclass(frozen=True)
class StudyResults:
    """A study at one of its cell sizes."""

    layout: Layout
    settings: studies.Study  # what conf/studies.yaml says of it
    grid: str  # the name of the cell size
    table: pd.DataFrame  # the study's rows of the table of results, at all its cell sizes

    @property
    def name(self) -> str:
        """The study's name, which is its data set's."""
        return self.settings.name

    @property
    def train(self) -> str:
        """The name of the training sequence; several are separated by blanks."""
        return self.settings.train_text

    @property
    def training(self) -> str:
        """What was learned, for a sentence: the training sequences, or a 3-D map."""
        return self.settings.training

    @property
    def simulated(self) -> bool:
        """Whether the data set is a simulated world."""
        return self.settings.simulated

    @property
    def where(self) -> str:
        """The study's name, which says if it is simulated: `simulated campus`."""
        return f"simulated {self.name}" if self.simulated else self.name

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of the study's grid."""
        return pick(self.table, grid=self.grid)

    @cached_property
    def unperturbed(self) -> pd.DataFrame:
        """The rows of unperturbed queries, stress sequences included, of the first seed."""
        return pick(self.rows[self.rows["ask"].isin([UNPERTURBED, STRESS])], seed=0)

    @cached_property
    def families(self) -> list[str]:
        """The models of the report, of the first seed: methods, and models that answer with poses.

        A study of the year has variants of methods too.
        """
        with_variants = self.settings.experiment == "year"
        return [
            model.name
            for model in self.settings.answerers
            if not model.seed and (model.posed or not model.variant or with_variants)
        ]

    @cached_property
    def models(self) -> dict[str, TrainingRecord]:
        """How each model of the report was trained."""
        return {name: TrainingRecord.read(self.find("train", model=name)) for name in self.families}

    @cached_property
    def trained(self) -> dict[str, Path]:
        """The file of every model of the study, variants and seeds too."""
        return {model.name: self.find("train", model=model.name) for model in self.settings.models}

    def recipe(self, model: str) -> Mapping[str, str]:
        """The parameters that a model was trained with."""
        return store.read_recipe(self.find("train", model=model))

    @cached_property
    def results(self) -> list[Result]:
        """The result of each model of the report on each test sequence."""
        results = []
        for score in read_scores(self.rows, self.settings.tests):
            if score.model in self.families:
                judged = self.artifact(Evaluations, "evaluate", score.sequence, score.model)
                results.append(
                    Result(score.model, score.sequence, score.days, score.rows, judged.case())
                )
        results.sort(key=lambda result: self.families.index(result.model))
        return [result for group in by_model(results).values() for result in group]

    @cached_property
    def ranked(self) -> list[str]:
        """The models of the report, the highest mean recall@1 by distance first."""
        return list(ranked(self.results))

    @property
    def best(self) -> str:
        """The model to give a robot: with poses if any has them, of the highest recall@1."""
        posed = {result.model for result in self.results if result.posed}
        return next((model for model in self.ranked if model in posed), self.ranked[0])

    @cached_property
    def cut_short(self) -> dict[str, float]:
        """Maps each model that had less than its own full training to the share that it had."""
        shares = {
            name: float(record.recipe.get("budget", 1.0))
            for name, record in self.models.items()
            if record.rounds
        }
        return {name: share for name, share in shares.items() if share < 1}

    @cached_property
    def train_xy_m(self) -> NDArray[np.float64]:
        """The training path (n, 2)."""
        poses = [
            self.artifact(Submaps, "submaps", sequence).world_T_anchor
            for sequence in self.settings.train
        ]
        return np.asarray(np.concatenate(poses)[:, :2, 3], np.float64)

    def drive(self, sequence: str) -> Drive:
        """The scans of a sequence; raises ArtifactError if they or their submaps are not here."""
        return Drive.read(self.find("scans", sequence), self.find("submaps", sequence))

    def trained_m(self) -> NDArray[np.float64]:
        """The points (n, 3) in the world of what stood along the training drives.

        Raises ArtifactError if their scans or submaps are not here.
        """
        return along(self.drive(sequence) for sequence in self.settings.train)

    @cached_property
    def footprint(self) -> Footprint | None:
        """Where something stood along the training drives; None if their scans are not here."""
        try:
            return Footprint.of(self.trained_m())
        except ArtifactError:
            return None

    @cached_property
    def labels(self) -> Labels:
        """The labels of the (first) training sequence."""
        return self.artifact(Labels, "labels", self.settings.train[0])

    @property
    def cell_m(self) -> float:
        """The side of a cell."""
        return float(self.labels.cell_m)

    @cached_property
    def distance(self) -> Distance:
        """The distances that the evaluations were judged by."""
        return Distance(**self._first_evaluations.distance)

    @cached_property
    def bootstrap(self) -> Bootstrap:
        """How the intervals of the evaluations were computed."""
        return Bootstrap(**self._first_evaluations.bootstrap)

    @cached_property
    def _first_evaluations(self) -> Evaluations:
        """Any of the study's evaluations: all were judged in the same way."""
        return self.artifact(Evaluations, "evaluate", self.settings.tests[0], self.families[0])

    def find(self, kind: str, sequence: str = "", model: str = "") -> Path:
        """The path of an artifact of a stage.

        Scans, submaps and labels go by sequence, models by model, other artifacts by both. A model
        that answers with poses is the same file as the one without, and its answers lie with the
        poses.
        """
        named = {answerer.name: answerer for answerer in self.settings.answerers}
        answerer = named.get(model)
        if kind == "localize" and answerer:
            return self.layout.answers(self.name, self.grid, answerer, sequence)
        learner = replace(answerer, posed=False, path="").name if answerer else model
        names: dict[str, tuple[str, ...]] = {
            "views": (self._view_of(answerer), sequence),
            "labels": (self.grid, sequence),
            "train": (self.grid, learner),
        }
        other_names = (self.grid, model, sequence) if model else (sequence,)
        return self.layout.path(kind, self.name, *names.get(kind, other_names))

    def _view_of(self, answerer: ModelName | None) -> str:
        """The name of what a model looks at; empty for no model."""
        if answerer is None:
            return ""
        methods = {method.name: method for method in self.settings.methods}
        return methods[answerer.method].view_of(answerer.variant)

    def artifact(self, kind: type[A], stage: str, sequence: str = "", model: str = "") -> A:
        """Open the artifact of a stage; raises ArtifactError where it is missing."""
        return store.read(self.find(stage, sequence, model), kind)

    def source(self, kind: str, sequence: str = "", model: str = "") -> str:
        """The path of an artifact as dvc.lock names it."""
        return self.find(kind, sequence, model).relative_to(self.layout.root.parent).as_posix()

    def folder(self, kind: str, *names: str) -> str:
        """The path of a folder of the study's artifacts, as dvc.lock names it."""
        path = self.layout.path(kind, self.name, *names)
        return path.relative_to(self.layout.root.parent).as_posix()
