"""The table of results: gathers all artifacts of a study into rows, one for each number.

The stage `results` writes the rows of `ResultsTable` to results.csv. `read` joins the tables of all
studies with their timings: these differ from run to run, so they have files of their own and
results.csv has the same bytes each time. Reports, the page, MLflow, `yearloc results` and sweeps
read this table and compute no metric of their own.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.schemas import Lifelong
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.caveats import NO_REFERENCE_POSES
from pipeline.evaluation.evaluations import Evaluation, Evaluations
from pipeline.evaluation.events import Bands
from pipeline.evaluation.lifelong import cost_rows, lifelong_rows
from pipeline.evaluation.paired import AUC_SHARE_KEPT, kept_share
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import (
    COLUMN_TYPES,
    COLUMNS,
    FLOAT_COLUMNS,
    TableRows,
    case_columns,
    evaluation_rows,
    placed,
    row,
    table,
)
from pipeline.evaluation.steadiness import AWC_FT, awc_ft
from pipeline.evaluation.study_rows import (
    Answers,
    ageing_rows,
    event_rows,
    paired_rows,
    reconstruction_rows,
    viewpoint_rows,
)
from pipeline.evaluation.validation import validation_auc
from pipeline.evaluation.viewpoint_matches import ViewpointMatches
from pipeline.formats.changes import read_changes
from pipeline.matching.rejection import VALIDATION, NoveltyEvidence
from pipeline.perturbations import read_cases
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study

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
    """Share of unseen queries that the validation AUC assumes."""

    def table(self) -> pd.DataFrame:
        """All rows of the study."""
        rows = [*self._answers(), *self._viewpoints(), *self._lifelong()]
        name = self.study.name
        return table(rows, study=name, dataset=name, simulated=self.study.simulated)

    def _answers(self) -> TableRows:
        """Rows of every model at every cell size on every sequence.

        At the study's further cell sizes (`cells`) only plain models have rows.
        """
        study = self.study
        grids = study.all_grids if study.tests_over_days else ()
        for grid in [cells.name for cells in grids]:
            is_own = grid in study.grid_names
            models = [model for model in study.answerers if is_own or _is_plain(model)]
            sequences = (*study.tests, *study.stress) if is_own else study.tests
            by_method: dict[str, dict[str, Evaluation]] = {}
            validation: dict[str, NDArray[np.float64]] = {}
            by_variant: dict[ModelName, dict[str, Evaluation]] = {}
            for model in models:
                place = {"grid": grid, **model.columns}
                opened = {name: self._evaluations(grid, model, name) for name in sequences}
                unperturbed = {name: opened[name].case() for name in sequences}
                for name in sequences:
                    rows = self._sequence_rows(name, opened[name], unperturbed[name])
                    yield from placed(rows, **place, sequence=name, days=unperturbed[name].days)
                # a model that only adds poses learns nothing of its own
                trained = {} if model.posed else self._trained(grid, model)
                kind = unperturbed[study.tests[0]].kinds[0]  # the kind of novelty in use
                if trained:
                    area = validation_auc(NoveltyEvidence.of(trained), kind, self.unseen_share)
                    yield place | row("validation_auc", "cells", area)
                by_day = sorted(study.tests, key=lambda name: (unperturbed[name].days, name))
                tests = {name: unperturbed[name] for name in by_day}
                for protocol in PROTOCOLS:
                    area = awc_ft(tests.values(), protocol)
                    yield place | row(AWC_FT, protocol, area)
                if _is_plain(model):
                    by_method[model.method] = tests
                    novelty = trained.get(f"{VALIDATION}seen/{kind}", ())
                    validation[model.method] = np.asarray(novelty, np.float64)
                elif (study.experiment == "year" or model.posed) and not model.seed:
                    by_variant[model] = tests
            if is_own:
                last = opened[sequences[-1]]
                yield {"grid": grid} | row("correct_m", "distance", last.distance["correct_m"])
                answers = Answers(by_method, validation, by_variant)
                rows = self._rows_across_sequences(answers, Bootstrap(**last.bootstrap))
                yield from placed(rows, grid=grid)

    def _sequence_rows(
        self, sequence: str, evaluations: Evaluations, unperturbed: Evaluation
    ) -> TableRows:
        """Rows of one model on one sequence, unperturbed and perturbed."""
        stress = self.study.stress.get(sequence, "")
        for i, case in enumerate(read_cases(evaluations.cases)):
            evaluation = evaluations.case(i) if i else unperturbed
            columns = case_columns(case, stress)
            yield from evaluation_rows(evaluation, case, stress)
            if case.change:
                resampling = Bootstrap(**evaluations.bootstrap)
                kept = kept_share(evaluation, unperturbed, "cells", resampling)
                yield columns | row(AUC_SHARE_KEPT, "cells", *kept)
            elif self.study.slam:
                yield from (
                    columns | row(NO_REFERENCE_POSES, protocol, 1.0) for protocol in PROTOCOLS
                )

    def _rows_across_sequences(self, answers: Answers, bootstrap: Bootstrap) -> TableRows:
        """Rows that take the evaluations of several sequences or methods."""
        yield from ageing_rows(answers, self.ageing)
        yield from paired_rows(answers, bootstrap)
        if self.study.experiment == "robustness":
            changes = {name: read_changes(self._path("events", name)) for name in self.study.tests}
            yield from event_rows(answers, changes, self.bands, bootstrap)

    def _viewpoints(self) -> TableRows:
        """Rows of every model on bird-views, on sequences that are matched with themselves."""
        methods = () if self.study.learns_further_days else self.study.bird_view_methods
        for grid, method in product(self.study.grid_names, methods):
            for model in method.models:
                place = {"grid": grid, **model.columns}
                folder = self._path("viewpoints", grid, model.name)
                if not folder.is_dir():
                    raise ArtifactError(f"{folder}: no such artifact; `dvc repro` builds it")
                for path in sorted(folder.glob("*.zarr")):
                    rows = viewpoint_rows(store.read(path, ViewpointMatches))
                    yield from placed(rows, **place, sequence=path.stem)
                yield from placed(reconstruction_rows(self._trained(grid, model)), **place)

    def _lifelong(self) -> TableRows:
        """Rows of every model after each day that it learned, by each order and strategy."""
        if not self.study.learns_further_days:
            return
        for grid, method in product(self.study.grid_names, self.study.methods):
            courses = [
                f"{order}-{name}" for order, names in method.courses.items() for name in names
            ]
            for model, course in product(method.models, courses):
                path = self._path("lifelong", grid, model.name, course)
                rows = lifelong_rows(store.read(path, Lifelong))
                yield from placed(rows, grid=grid, **model.columns)

    def evaluation(self, grid: str, model: ModelName, sequence: str) -> Evaluation:
        """Read a model's evaluation in one unperturbed sequence."""
        return self._evaluations(grid, model, sequence).case()

    def _evaluations(self, grid: str, model: ModelName, sequence: str) -> Evaluations:
        return store.read(self._path("evaluate", grid, model.name, sequence), Evaluations)

    def _trained(self, grid: str, model: ModelName) -> Mapping[str, NDArray[Any]]:
        return store.read_model(self._path("train", grid, model.name))

    def _path(self, kind: str, *names: str) -> Path:
        """The path of an artifact of the study."""
        return self.layout.path(kind, self.study.name, *names)


def _is_plain(model: ModelName) -> bool:
    """Whether a model has its method's own settings, seed 0, and no poses."""
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
    """Read a table of results; raises ArtifactError for another file, or one that is cut off."""
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
            f"{path}: not a table of results ({str(error).strip()}); `dvc repro` rewrites it"
        ) from None


def where(frame: pd.DataFrame, conditions: Mapping[str, str]) -> pd.DataFrame:
    """The rows of a table that meet all conditions: column to the wanted text.

    A condition may list several texts, with commas between them. For a number, 20 also matches
    20.0. Raises ConfigError for a column that the table does not have.
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
