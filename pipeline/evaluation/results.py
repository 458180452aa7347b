"""The one table of results: every number that anyone reads is a row of it, gathered from artifacts.

Reports, the page, MLflow, `yearloc results` and sweeps read this table and compute no metric of
their own. Its rows are kept as csv, a file a study; timings, which differ from run to run, have a
csv of their own and are added when the table is read.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

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
    COLUMNS,
    NUMERIC,
    TYPED,
    TYPES,
    WORDS,
    TableRows,
    case_columns,
    of_evaluation,
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
from pipeline.matching.rejection import PREFIX, Evidence
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study, StudyMethod

FILE = "results.csv"


@dataclass(frozen=True)
class Gathering:
    """Gathers the table of one study of conf/studies.yaml.

    Raises ArtifactError for an artifact that is missing.
    """

    layout: Layout
    study: Study
    ageing: Ageing
    bands: Bands
    unseen_share: float  # of queries, that the held-out AUC expects

    def table(self) -> pd.DataFrame:
        """All rows of the study."""
        rows = [*self._answers(), *self._viewpoints(), *self._lifelong()]
        name = self.study.name
        return table(rows, study=name, dataset=name, simulated=self.study.simulated)

    def _answers(self) -> TableRows:
        """Rows of every model at every cell size on every sequence.

        For the study's own cells also rows of several evaluations together.
        """
        tests = self.study.tests
        stress = self.study.stress
        models = self.study.answerers
        for grid in self._all_grids():
            is_own_grid = grid in self.study.grid_names
            of_methods: dict[str, dict[str, Evaluation]] = {}
            of_variants: dict[tuple[str, str], dict[str, Evaluation]] = {}
            held_out = {}
            bootstrap = Bootstrap()
            for model in (
                models if is_own_grid else [model for model in models if model.name == model.method]
            ):
                place = {"grid": grid, **model.columns}
                as_driven: dict[str, Evaluation] = {}
                for sequence in (*tests, *stress) if is_own_grid else tests:
                    artifact = self._evaluations(grid, model, sequence)
                    for i, case in enumerate(read_cases(artifact.cases)):
                        evaluation = artifact.case(i)
                        of_sequence = {
                            "sequence": sequence,
                            "days": evaluation.days,
                            "stress": stress.get(sequence, ""),
                        }
                        yield from (
                            place | of_sequence | columns
                            for columns in of_evaluation(evaluation, case)
                        )
                        if not case.change:
                            as_driven[sequence] = evaluation
                            yield from (
                                place | of_sequence | row(NO_SURVEY, protocol, 1.0)
                                for protocol in (PROTOCOLS if self.study.slam else ())
                            )
                            continue
                        kept = kept_share(
                            evaluation,
                            as_driven[sequence],
                            "cells",
                            Bootstrap(**artifact.attrs["bootstrap"]),
                        )
                        yield place | of_sequence | case_columns(case) | row(KEPT, "cells", *kept)
                by_day = {
                    name: as_driven[name]
                    for name in sorted(tests, key=lambda name: (as_driven[name].days, name))
                }
                if not model.posed:
                    learned = store.read_model(self._path("train", grid, model.name))
                    kind = as_driven[tests[0]].kinds[0]
                    area = held_out_auc(Evidence.of(learned), kind, self.unseen_share)
                    yield place | row("held_out_auc", "cells", area)
                if model.name == model.method:
                    of_methods[model.method] = by_day
                    held_out[model.method] = np.asarray(
                        learned.get(f"{PREFIX}seen/{kind}", ()), np.float64
                    )
                    bootstrap = Bootstrap(**artifact.bootstrap)
                elif (self.study.question == "year" or model.posed) and not model.seed:
                    of_variants[model.method, model.answered] = by_day
            if is_own_grid:
                yield {"grid": grid} | row("correct_m", "distance", artifact.distance["correct_m"])
                yield from (
                    {"grid": grid} | columns
                    for columns in self._together(
                        Answers(of_methods, held_out, of_variants), bootstrap
                    )
                )

    def _together(self, answers: Answers, bootstrap: Bootstrap) -> TableRows:
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
                    place = {"grid": grid, **model.columns}
                    folder = self._path("viewpoints", grid, model.name)
                    if not folder.is_dir():
                        raise ArtifactError(f"{folder}: no such artifact; `dvc repro` builds it")
                    for path in sorted(folder.glob("*.zarr")):
                        judged = store.read(path, ViewpointMatches)
                        yield from (
                            place | {"sequence": path.stem} | columns
                            for columns in viewpoint_rows(judged)
                        )
                    learned = store.read_model(self._path("train", grid, model.name))
                    yield from (place | columns for columns in reconstruction_rows(learned))

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
                place = {"grid": grid, **model.columns}
                for order, strategies in method.courses.items():
                    for strategy in strategies:
                        path = self._path("lifelong", grid, model.name, f"{order}-{strategy}")
                        yield from (
                            place | columns for columns in lifelong_rows(store.read(path, Lifelong))
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
        courses = sorted(
            layout.path("lifelong", name).glob("*/*/*.json")
        )  # beside the artifacts, not in them
        costs = [cost_rows(json.loads(course.read_text(encoding="utf-8"))) for course in courses]
        frames += [table(row for rows in costs for row in rows)] if costs else []
        timings = sorted(layout.path("latency", name).glob("*.csv")) if study.latency else []
        frames += [_parsed(csv) for csv in (path, *timings)]
    return pd.concat(frames, ignore_index=True) if frames else table([])


def _parsed(path: Path) -> pd.DataFrame:
    try:
        na_values = {name: [""] for name in NUMERIC}
        frame = pd.read_csv(path, dtype=TYPES, keep_default_na=False, na_values=na_values)[
            [*COLUMNS, *TYPED]
        ]
        if frame[[*WORDS]].isna().any(axis=None):
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
            text.isin(texts) | (column in NUMERIC and text.str.removesuffix(".0").isin(texts))
        ]
    return frame
