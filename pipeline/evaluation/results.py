"""The table of results: all artifacts of a study in; a row a number out.

The stage `results` gathers it into results.csv. `read` joins the tables of all studies, and the
timings of `latency` and `lifelong`: these differ from run to run and stand in files of their own,
so that results.csv has the same bytes each time. Reports, the page, MLflow, `yearloc results` and
sweeps read this table and compute no metric of their own.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.alterations import read_cases
from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.schemas import Lifelong
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.doubts import NO_SURVEY
from pipeline.evaluation.events import Bands
from pipeline.evaluation.held_out import held_out_auc
from pipeline.evaluation.judgement import Evaluation, Evaluations
from pipeline.evaluation.lifelong import cost_rows, lifelong_rows
from pipeline.evaluation.paired import KEPT, kept_share
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import (
    CASE_COLUMNS,
    COLUMN_TYPES,
    COLUMNS,
    FLOAT_COLUMNS,
    TEXT_COLUMNS,
    TableRows,
    case_columns,
    evaluation_rows,
    row,
    table,
)
from pipeline.evaluation.study_rows import (
    Answers,
    ageing_rows,
    event_rows,
    paired_rows,
    reconstruction_rows,
    viewpoint_rows,
)
from pipeline.evaluation.viewpoints import ViewpointMatches
from pipeline.formats.changes import read_changes
from pipeline.matching.rejection import HELD_OUT, Evidence
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study, StudyMethod

FILE = "results.csv"


@dataclass(frozen=True)
class ResultsTable:
    """The table of one study of conf/studies.yaml, gathered from its artifacts.

    Raises ArtifactError for an artifact that is missing.
    """

    layout: Layout
    study: Study
    ageing: Ageing
    bands: Bands
    unseen_share: float
    """Share of unseen queries that the held-out AUC assumes."""

    def table(self) -> pd.DataFrame:
        """All rows of the study."""
        rows = [*self._answers(), *self._viewpoints(), *self._lifelong()]
        name = self.study.name
        return table(rows, study=name, dataset=name, simulated=self.study.simulated)

    def _answers(self) -> TableRows:
        """Rows of every model at every cell size on every sequence."""
        models = self.study.answerers
        for grid in self._all_grids():
            if grid in self.study.grid_names:
                yield from self._answers_at_own_grid(grid, models)
                continue
            for model in models:
                if model.name == model.method:
                    yield from self._model_rows(grid, model, self.study.tests)

    def _answers_at_own_grid(self, grid: str, models: Sequence[ModelName]) -> TableRows:
        """Rows of every model at a cell size of the study, and rows of several evaluations."""
        sequences = (*self.study.tests, *self.study.stress)
        by_method: dict[str, dict[str, Evaluation]] = {}
        held_out: dict[str, NDArray[np.float64]] = {}
        by_variant: dict[tuple[str, str], dict[str, Evaluation]] = {}
        bootstrap = Bootstrap()
        for model in models:
            yield from self._model_rows(grid, model, sequences)
            evaluations = self._tests_in_order_of_days(grid, model)
            if model.name == model.method:
                by_method[model.method] = evaluations
                held_out[model.method] = self._held_out_novelty(grid, model)
                bootstrap = self._bootstrap(grid, model)
            elif (self.study.question == "year" or model.posed) and not model.seed:
                by_variant[model.method, model.answered] = evaluations
        correct_m = self._evaluations(grid, models[-1], sequences[-1]).distance["correct_m"]
        yield {"grid": grid} | row("correct_m", "distance", correct_m)
        answers = Answers(by_method, held_out, by_variant)
        for columns in self._rows_across_sequences(answers, bootstrap):
            yield {"grid": grid} | columns

    def _model_rows(self, grid: str, model: ModelName, sequences: Sequence[str]) -> TableRows:
        """Rows of one model on every sequence, and of its held-out places."""
        model_columns = {"grid": grid, **model.columns}
        for sequence in sequences:
            for columns in self._sequence_rows(grid, model, sequence):
                yield model_columns | columns
        if not model.posed:
            evidence = Evidence.of(self._trained(grid, model))
            area = held_out_auc(evidence, self._novelty_kind(grid, model), self.unseen_share)
            yield model_columns | row("held_out_auc", "cells", area)

    def _sequence_rows(self, grid: str, model: ModelName, sequence: str) -> TableRows:
        """Rows of one model on one sequence, as driven and altered."""
        evaluations = self._evaluations(grid, model, sequence)
        as_driven = evaluations.case()
        sequence_columns = {
            "sequence": sequence,
            "days": as_driven.days,
            "stress": self.study.stress.get(sequence, ""),
        }
        for i, case in enumerate(read_cases(evaluations.cases)):
            evaluation = evaluations.case(i)
            for columns in evaluation_rows(evaluation, case):
                yield sequence_columns | columns
            if case.change:
                resampling = Bootstrap(**evaluations.attrs["bootstrap"])
                kept = kept_share(evaluation, as_driven, "cells", resampling)
                yield sequence_columns | case_columns(case) | row(KEPT, "cells", *kept)
            elif self.study.slam:
                for protocol in PROTOCOLS:
                    yield sequence_columns | row(NO_SURVEY, protocol, 1.0)

    def _tests_in_order_of_days(self, grid: str, model: ModelName) -> dict[str, Evaluation]:
        evaluations = {
            sequence: self.evaluation(grid, model, sequence) for sequence in self.study.tests
        }
        return dict(sorted(evaluations.items(), key=lambda item: (item[1].days, item[0])))

    def _held_out_novelty(self, grid: str, model: ModelName) -> NDArray[np.float64]:
        """Novelty of held-out places that were learned; empty where the method holds none out."""
        name = f"{HELD_OUT}seen/{self._novelty_kind(grid, model)}"
        return np.asarray(self._trained(grid, model).get(name, ()), np.float64)

    def _novelty_kind(self, grid: str, model: ModelName) -> str:
        """The kind of novelty by which the model's answers are refused."""
        return self.evaluation(grid, model, self.study.tests[0]).kinds[0]

    def _bootstrap(self, grid: str, model: ModelName) -> Bootstrap:
        sequences = (*self.study.tests, *self.study.stress)
        return Bootstrap(**self._evaluations(grid, model, sequences[-1]).bootstrap)

    def _trained(self, grid: str, model: ModelName) -> dict[str, NDArray[Any]]:
        return store.read_model(self._path("train", grid, model.name))

    def _rows_across_sequences(self, answers: Answers, bootstrap: Bootstrap) -> TableRows:
        yield from ageing_rows(answers, self.ageing)
        yield from paired_rows(answers, bootstrap)
        if self.study.question == "robustness":
            changes = {name: read_changes(self._path("events", name)) for name in self.study.tests}
            yield from event_rows(answers, changes, self.bands, bootstrap)

    def _viewpoints(self) -> TableRows:
        """Rows of every model on bird-views, on sequences matched with themselves."""
        for grid in self.study.grid_names:
            for method in self._on_bird_views():
                for model in method.models:
                    model_columns = {"grid": grid, **model.columns}
                    folder = self._path("viewpoints", grid, model.name)
                    if not folder.is_dir():
                        raise ArtifactError(f"{folder}: no such artifact; `dvc repro` builds it")
                    for path in sorted(folder.glob("*.zarr")):
                        judged = store.read(path, ViewpointMatches)
                        yield from (
                            model_columns | {"sequence": path.stem} | columns
                            for columns in viewpoint_rows(judged)
                        )
                    yield from (
                        model_columns | columns
                        for columns in reconstruction_rows(self._trained(grid, model))
                    )

    def _all_grids(self) -> list[str]:
        """The names of all cell sizes at which places are ranked."""
        grids = self.study.all_grids if self.study.asks_about_the_year else ()
        return [grid.name for grid in grids]

    def _on_bird_views(self) -> Sequence[StudyMethod]:
        return self.study.bird_view_methods if not self.study.learns_further_days else ()

    def _lifelong(self) -> TableRows:
        """Rows of every model after each day that it learned, in each order and strategy."""
        if not self.study.learns_further_days:
            return
        for grid, method in product(self.study.grid_names, self.study.methods):
            for model in method.models:
                model_columns = {"grid": grid, **model.columns}
                for order, strategies in method.courses.items():
                    for strategy in strategies:
                        path = self._path("lifelong", grid, model.name, f"{order}-{strategy}")
                        yield from (
                            model_columns | columns
                            for columns in lifelong_rows(store.read(path, Lifelong))
                        )

    def evaluation(self, grid: str, model: ModelName, sequence: str) -> Evaluation:
        """Read a model's evaluation in one sequence as driven."""
        return self._evaluations(grid, model, sequence).case()

    def _evaluations(self, grid: str, model: ModelName, sequence: str) -> Evaluations:
        return store.read(self._path("evaluate", grid, model.name, sequence), Evaluations)

    def _path(self, kind: str, *names: str) -> Path:
        return self.layout.path(kind, self.study.name, *names)


def read(layout: Layout, studies: Mapping[str, Study]) -> pd.DataFrame:
    """Read the table of some studies by name, with their timings.

    Raises ArtifactError where a study has none yet.
    """
    frames = []
    for name, study in studies.items():
        path = layout.path("results", name, FILE)
        if not path.is_file():
            raise ArtifactError(f"{path}: no results yet; `dvc repro` gathers them")
        # the stage writes its timings as json beside each artifact
        courses = sorted(layout.path("lifelong", name).glob("*/*/*.json"))
        costs = [cost_rows(json.loads(course.read_text(encoding="utf-8"))) for course in courses]
        frames += [table(columns for rows in costs for columns in rows)] if costs else []
        timings = sorted(layout.path("latency", name).glob("*.csv")) if study.latency else []
        frames += [_read_csv(csv) for csv in (path, *timings)]
    return pd.concat(frames, ignore_index=True) if frames else table([])


def _read_csv(path: Path) -> pd.DataFrame:
    try:
        na_values = {name: [""] for name in FLOAT_COLUMNS}
        frame = pd.read_csv(path, dtype=COLUMN_TYPES, keep_default_na=False, na_values=na_values)[
            [*COLUMNS, *CASE_COLUMNS]
        ]
        if frame[[*TEXT_COLUMNS]].isna().any(axis=None):
            raise ValueError("a row is cut off")
        return frame
    except (ValueError, KeyError) as error:
        raise ArtifactError(
            f"{path}: not a table of results ({str(error).strip()}); `dvc repro` writes it anew"
        ) from None


def where(frame: pd.DataFrame, conditions: Mapping[str, str]) -> pd.DataFrame:
    """The rows whose columns have the wanted texts.

    A condition is one text or several with commas between; 20 is 20.0 too. Raises ConfigError for a
    column that the table has not.
    """
    for column, condition in conditions.items():
        if column not in COLUMNS:
            raise ConfigError(
                f"--where {column}={condition}: expected one of the columns {', '.join(COLUMNS)}"
            )
        text = frame[column].astype(str)
        texts = condition.split(",")
        frame = frame[
            text.isin(texts) | (column in FLOAT_COLUMNS and text.str.removesuffix(".0").isin(texts))
        ]
    return frame
