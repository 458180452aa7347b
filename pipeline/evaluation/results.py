"""The table of results: gathers all artifacts of a study into rows, one for each number.

The stage `results` writes the rows of `ResultsTable` to results.csv. `read` joins the tables of all
studies with their timings: these differ from run to run, so they have files of their own and
results.csv has the same bytes each time. Reports, the page, MLflow, `yearloc results` and sweeps
read this table and compute no metric of their own.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import chain, product
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
    COLUMN_TYPES,
    COLUMNS,
    FLOAT_COLUMNS,
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

    Its methods raise ArtifactError for an artifact that is missing.
    """

    layout: Layout
    study: Study
    ageing: Ageing
    """How lines over the days are fitted."""
    bands: Bands
    """How queries are grouped by their distance to a change of the world."""
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
                yield from self._answers_at_study_grid(grid, models)
            else:
                for model in models:
                    if _is_plain(model):
                        yield from self._model_rows(grid, model, self.study.tests)

    def _answers_at_study_grid(self, grid: str, models: Sequence[ModelName]) -> TableRows:
        """Rows of every model at a cell size of the study, and rows that take several evaluations.

        The study's further cell sizes (`cells`) have only rows of the first kind, of plain models.
        """
        sequences = (*self.study.tests, *self.study.stress)
        by_method: dict[str, dict[str, Evaluation]] = {}
        held_out: dict[str, NDArray[np.float64]] = {}
        by_variant: dict[ModelName, dict[str, Evaluation]] = {}
        bootstrap = Bootstrap()
        for model in models:
            yield from self._model_rows(grid, model, sequences)
            evaluations = self._tests_in_order_of_days(grid, model)
            if _is_plain(model):
                by_method[model.method] = evaluations
                held_out[model.method] = self._held_out_novelty(grid, model)
                bootstrap = self._bootstrap(grid, model)
            elif (self.study.question == "year" or model.posed) and not model.seed:
                by_variant[model] = evaluations
        correct_m = self._evaluations(grid, models[-1], sequences[-1]).distance["correct_m"]
        yield {"grid": grid} | row("correct_m", "distance", correct_m)
        answers = Answers(by_method, held_out, by_variant)
        for columns in self._rows_across_sequences(answers, bootstrap):
            yield {"grid": grid} | columns

    def _model_rows(self, grid: str, model: ModelName, sequences: Sequence[str]) -> TableRows:
        """Rows of one model on every sequence, and its AUC on held-out blocks of training."""
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
        sequence_columns = {"sequence": sequence, "days": as_driven.days}
        stress = self.study.stress.get(sequence, "")
        for i, case in enumerate(read_cases(evaluations.cases)):
            evaluation = evaluations.case(i)
            for columns in evaluation_rows(evaluation, case, stress):
                yield sequence_columns | columns
            if case.change:
                resampling = Bootstrap(**evaluations.attrs["bootstrap"])
                kept = kept_share(evaluation, as_driven, "cells", resampling)
                yield sequence_columns | case_columns(case) | row(KEPT, "cells", *kept)
            elif self.study.slam:
                for protocol in PROTOCOLS:
                    columns = sequence_columns | case_columns(case, stress)
                    yield columns | row(NO_SURVEY, protocol, 1.0)

    def _tests_in_order_of_days(self, grid: str, model: ModelName) -> dict[str, Evaluation]:
        """The evaluations of the test sequences by name, the first day first."""
        evaluations = {
            sequence: self.evaluation(grid, model, sequence) for sequence in self.study.tests
        }
        return dict(sorted(evaluations.items(), key=lambda item: (item[1].days, item[0])))

    def _held_out_novelty(self, grid: str, model: ModelName) -> NDArray[np.float64]:
        """The novelty (h,) of the queries on held-out blocks, asked as seen; empty without any."""
        name = f"{HELD_OUT}seen/{self._novelty_kind(grid, model)}"
        return np.asarray(self._trained(grid, model).get(name, ()), np.float64)

    def _novelty_kind(self, grid: str, model: ModelName) -> str:
        """The kind of novelty by which the model's answers are rejected."""
        return self.evaluation(grid, model, self.study.tests[0]).kinds[0]

    def _bootstrap(self, grid: str, model: ModelName) -> Bootstrap:
        """The bootstrap that the intervals of a model's evaluations were computed with."""
        sequences = (*self.study.tests, *self.study.stress)
        return Bootstrap(**self._evaluations(grid, model, sequences[-1]).bootstrap)

    def _trained(self, grid: str, model: ModelName) -> dict[str, NDArray[Any]]:
        """The arrays of a trained model."""
        return store.read_model(self._path("train", grid, model.name))

    def _rows_across_sequences(self, answers: Answers, bootstrap: Bootstrap) -> TableRows:
        """Rows that take the evaluations of several sequences or methods."""
        yield from ageing_rows(answers, self.ageing)
        yield from paired_rows(answers, bootstrap)
        if self.study.question == "robustness":
            changes = {name: read_changes(self._path("events", name)) for name in self.study.tests}
            yield from event_rows(answers, changes, self.bands, bootstrap)

    def _viewpoints(self) -> TableRows:
        """Rows of every model on bird-views, on sequences that are matched with themselves."""
        for grid, method in product(self.study.grid_names, self._on_bird_views()):
            for model in method.models:
                for columns in self._viewpoint_rows(grid, model):
                    yield {"grid": grid, **model.columns} | columns

    def _viewpoint_rows(self, grid: str, model: ModelName) -> TableRows:
        """Rows of one model on bird-views."""
        folder = self._path("viewpoints", grid, model.name)
        if not folder.is_dir():
            raise ArtifactError(f"{folder}: no such artifact; `dvc repro` builds it")
        for path in sorted(folder.glob("*.zarr")):
            for columns in viewpoint_rows(store.read(path, ViewpointMatches)):
                yield {"sequence": path.stem} | columns
        yield from reconstruction_rows(self._trained(grid, model))

    def _all_grids(self) -> list[str]:
        """The names of all cell sizes at which places are ranked, the study's own among them."""
        grids = self.study.all_grids if self.study.asks_about_the_year else ()
        return [grid.name for grid in grids]

    def _on_bird_views(self) -> Sequence[StudyMethod]:
        """The methods that are judged by `viewpoints`."""
        return self.study.bird_view_methods if not self.study.learns_further_days else ()

    def _lifelong(self) -> TableRows:
        """Rows of every model after each day that it learned, by each order and strategy."""
        if not self.study.learns_further_days:
            return
        for grid, method in product(self.study.grid_names, self.study.methods):
            for model in method.models:
                for course in _course_names(method):
                    path = self._path("lifelong", grid, model.name, course)
                    for columns in lifelong_rows(store.read(path, Lifelong)):
                        yield {"grid": grid, **model.columns} | columns

    def evaluation(self, grid: str, model: ModelName, sequence: str) -> Evaluation:
        """Read a model's evaluation in one sequence as driven."""
        return self._evaluations(grid, model, sequence).case()

    def _evaluations(self, grid: str, model: ModelName, sequence: str) -> Evaluations:
        """Read a model's evaluations in one sequence, in all cases."""
        return store.read(self._path("evaluate", grid, model.name, sequence), Evaluations)

    def _path(self, kind: str, *names: str) -> Path:
        """The path of an artifact of the study."""
        return self.layout.path(kind, self.study.name, *names)


def _course_names(method: StudyMethod) -> list[str]:
    """The artifacts of `lifelong` of one model: an order of the further days, and a strategy."""
    return [
        f"{order}-{strategy}"
        for order, strategies in method.courses.items()
        for strategy in strategies
    ]


def _is_plain(model: ModelName) -> bool:
    """Whether a model is of a method's own settings, seed 0, and without poses."""
    return model.name == model.method


def read(layout: Layout, studies: Mapping[str, Study]) -> pd.DataFrame:
    """Read the joined table of some studies, given by name, with their timings.

    Raises ArtifactError for a study whose table is not there yet.
    """
    frames = []
    for name, study in studies.items():
        path = layout.path("results", name, FILE)
        if not path.is_file():
            raise ArtifactError(f"{path}: no results yet; `dvc repro` gathers them")
        # The stage `lifelong` writes its timings as json beside each artifact.
        cost_files = sorted(layout.path("lifelong", name).glob("*/*/*.json"))
        costs = [cost_rows(json.loads(file.read_text(encoding="utf-8"))) for file in cost_files]
        if costs:
            frames.append(table(chain.from_iterable(costs)))
        frames.append(_read_csv(path))
        if study.latency:
            timing_files = sorted(layout.path("latency", name).glob("*.csv"))
            frames += [_read_csv(file) for file in timing_files]
    return pd.concat(frames, ignore_index=True) if frames else table([])


def _read_csv(path: Path) -> pd.DataFrame:
    """Read a table of results; raises ArtifactError for a file that is none, or is cut off."""
    try:
        na_values = {name: [""] for name in FLOAT_COLUMNS}
        text = path.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            raise ValueError("a row is cut off")
        return pd.read_csv(
            StringIO(text), dtype=COLUMN_TYPES, keep_default_na=False, na_values=na_values
        )[[*COLUMNS]]
    except (ValueError, KeyError) as error:
        raise ArtifactError(
            f"{path}: not a table of results ({str(error).strip()}); `dvc repro` writes it anew"
        ) from None


def where(frame: pd.DataFrame, conditions: Mapping[str, str]) -> pd.DataFrame:
    """The rows of a table that meet all conditions: column to the wanted text.

    A condition may list several texts, with commas between them. For a number, 20 also matches
    20.0. Raises ConfigError for a column that the table has not.
    """
    for column, condition in conditions.items():
        if column not in COLUMNS:
            raise ConfigError(
                f"--where {column}={condition}: expected one of the columns {', '.join(COLUMNS)}"
            )
        wanted = condition.split(",")
        text = frame[column].astype(str)
        matches = text.isin(wanted)
        if column in FLOAT_COLUMNS:
            matches |= text.str.removesuffix(".0").isin(wanted)
        frame = frame[matches]
    return frame
