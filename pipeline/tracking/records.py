"""Builds the runs that MLflow shows, from the table of results and the records of sweeps.

There is one run for each method, with a child run for each test sequence; one for each course of
learning further days; and one for each sweep, with a child run for each job. Nothing is computed
here but means over test days or seeds. `stage_costs` reads what the stages of a method took, for
its run. `runs.publish` writes the runs to MLflow.

A row of the table of results (`evaluation.rows`) is one value. Its column `number` names the metric
and `protocol` says how answers are judged; `ask` is the kind of queries, such as `perturbed`, and
`of` and `at` say which of this kind, such as the perturbation and its level.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import COURSE, HEADING, NOVELTY, UNPERTURBED, pick
from pipeline.evaluation.steadiness import AWC_FT
from pipeline.evaluation.study_rows import AGEING, PERCENTILE
from pipeline.running.dvc_files import DvcLock
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.catalogue import description_of
from pipeline.studies.colours import PALETTE, colour, darker
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study, StudyMethod
from pipeline.sweeps.record import Record
from pipeline.tracking.page import COLOUR, filled
from pipeline.tracking.runs import RunRecord, UsedSequence

# The charts of a sweep's own run: the name of each, and the protocol and metric whose mean over the
# test days it shows for each job.
CHARTED = {
    "cells_auc_top1": ("cells", "auc_top1"),
    "cells_recall_at_1": ("cells", "recall_at_1"),
    "distance_recall_at_1": ("distance", "recall_at_1"),
    "validation_auc": ("cells", "validation_auc"),
}
NOT_OF_JOBS = ("queries", "turned_share")  # metrics that a sweep's jobs do not show
# Metrics by cells that are shown for each novelty measure, and their names there.
REJECTION = {
    "auroc": "auroc",
    "precision_at_threshold": "precision",
    "recall_at_threshold": "recall",
}
# The group in MLflow of each metric that is not grouped by its protocol. MLflow sorts groups by
# name: `accepted` is to be first.
GROUPS = {
    **dict.fromkeys(("accepted", "accepted_wrong", "refused", "refused_wrong"), "accepted"),
    "ece": "calibration",
    "ece_raw": "calibration",
    PERCENTILE: "ageing",
}
# Protocol and metric of the means over the test days that a method's run holds; without them
# MLflow's table of runs would show the values of the last day alone.
MEANS = (
    ("cells", "auc_top1"),
    ("cells", "recall_at_1"),
    ("cells", "auroc"),
    ("distance", "auc_top1"),
    ("distance", "recall_at_1"),
    ("distance", "recall_at_5"),
    ("distance", "auroc"),
    ("distance", "heading_within_10deg"),
)
DIGEST_LENGTH = 8  # characters, as many as MLflow's own digests of data sets have
LARGEST = 1e30  # a larger value is a threshold that rejects nothing, and is not shown
LONGEST_NAME = 240  # characters of a run's name: MLflow's databases hold 250
Series = dict[str, list[tuple[int, float]]]  # name of a metric to its points: (step, value)


@dataclass(frozen=True)
class StudyRuns:
    """Builds the runs of one study at one cell size, from its rows and figures."""

    study: Study
    grid: str
    rows: pd.DataFrame  # of the table of results, of this study and cell size alone
    figures: Path  # the folder of its report, with the list of which model each figure shows
    lock: DvcLock = field(default_factory=lambda: DvcLock({}))  # for the digests of sequences

    def method_run(
        self,
        model_name: ModelName,
        arrays: Mapping[str, NDArray[Any]],
        recipe: Mapping[str, str],
        extra_series: Series,
    ) -> RunRecord:
        """The run of a method, or of its pose variant, with a child for each test sequence.

        `model_name` names the model, and whether its answers carry poses; the table of results has
        such answers under a variant of their own, such as `pose`. `arrays` and `recipe` are what
        the model's file holds; `extra_series` are further metrics.
        """
        study = self.study
        method_and_variant = model_name.family  # such as `sci` or `sci-pose`
        rows = pick(self.rows, model=method_and_variant, seed=0)
        unperturbed = pick(rows, ask=UNPERTURBED)
        tested = rows[rows["sequence"].isin(study.tests)]
        series = days_series(tested) | mean_series(tested) | training_series(arrays)
        series |= ageing_series(unperturbed) | viewpoint_series(rows) | extra_series
        dataset_and_grid = {"dataset": study.name, "grid": self.grid}
        run_colour = colour(method_and_variant)
        if model_name.posed:
            run_colour = darker(run_colour)
        run = RunRecord(
            name=self.run_name(method_and_variant),
            tags={
                COLOUR: run_colour,
                **dataset_and_grid,
                "method": method_and_variant,
                "data": self.data,
            },
            params={**dataset_and_grid, "train": study.train_text, **recipe},
            series=series,
            figures=self.figure_files(method_and_variant),
            # a model is registered once, not again for its pose variant
            registered="" if model_name.posed else self._registered(method_and_variant),
            about=self._about(
                "run.md.j2",
                what=description_of(recipe.get("_target_", "")),
                method=method_and_variant,
                # the fraction of its full training that the study's budget gives the method
                share=recipe.get("budget", ""),
                places=len(arrays.get("place_xy_m", ())),
            ),
            used=used_sequences(study, study.tests, self.lock),
        )
        children = [self._day(run, method_and_variant, test, tested) for test in study.tests]
        return replace(run, children=children)

    def _day(self, run: RunRecord, model: str, test: str, rows: pd.DataFrame) -> RunRecord:
        """The child of a method's run that holds one test sequence."""
        day_rows = pick(rows, sequence=test)
        days = day_rows["days"].dropna().astype(int).tolist()
        return RunRecord(
            name=test,
            tags={**run.tags, "sequence": test},
            params={**run.params, "test": test},
            series=days_series(day_rows),
            figures=self.figure_files(model, test),
            about=self._about("day.md.j2", sequence=test, days=days[0] if days else None),
            used=used_sequences(self.study, [test], self.lock, with_training=False),
        )

    @property
    def data(self) -> str:
        """`simulated` or `recorded`, as the study's data are."""
        return "simulated" if self.study.simulated else "recorded"

    def run_name(self, model: str) -> str:
        """The name of a model's run, with the grid if the study has several.

        It is short, since MLflow's legend has room for two lines of run names.
        """
        return model if self.study.grid_names == [self.grid] else f"{model} {self.grid}"

    def _registered(self, model: str) -> str:
        """The name of the method's model in the registry, such as campus-sci-simulated."""
        words = [self.study.name, *self.run_name(model).split()]
        if self.study.simulated:
            words.append("simulated")
        return "-".join(words)

    def _about(self, template_name: str, **values: Any) -> str:
        """The description of a run, from a template."""
        return filled(
            template_name,
            study=self.study.name,
            grid=self.grid,
            simulated=self.study.simulated,
            train=self.study.train_text,
            tests=self.study.tests,
            budget=self.study.budget,
            **values,
        )

    def figure_files(self, model: str, sequence: str = "") -> list[Path]:
        """The figures of a model and those of all models; or those of a model on one test sequence.

        Raises ArtifactError if there is no report: DVC removes the old one before it writes
        another.
        """
        manifest = self.figures / "figures.json"
        if not manifest.is_file():
            raise ArtifactError(f"{self.figures}: no report yet; `dvc repro` writes it")
        models = {model} if sequence else {model, ""}
        names = dict.fromkeys(
            entry["file"]
            for entry in json.loads(manifest.read_text(encoding="utf-8"))
            if entry["sequence"] == sequence and entry["model"] in models
        )
        return [self.figures / name for name in names]


def used_sequences(
    study: Study, tests: Sequence[str], lock: DvcLock, with_training: bool = True
) -> list[UsedSequence]:
    """The training sequences, if `with_training`, and the test sequences.

    A digest covers the sequence's name, and the digest of the study's submaps in DVC's lock files,
    or the study's settings if the lock files record no submaps.
    """
    folder = Layout().path("submaps", study.name).as_posix()
    submaps_digest = lock.of(folder)[0] or json.dumps(study.table(), sort_keys=True, default=str)
    digests = {
        sequence: hashlib.sha256(f"{submaps_digest} {sequence}".encode()).hexdigest()
        for sequence in (*study.train, *tests)
    }
    training = study.train if with_training else ()
    contexts = dict.fromkeys(training, "train") | dict.fromkeys(tests, "test")
    return [
        UsedSequence(
            name=f"{study.name} {sequence}",
            digest=digests[sequence][:DIGEST_LENGTH],
            context=context,
            source=Layout().path("submaps", study.name, sequence).as_posix(),
        )
        for sequence, context in contexts.items()
    ]


def of_strategies(study_runs: StudyRuns) -> Iterator[RunRecord]:
    """The runs of a study of learning further days: one for each course and model.

    A course is an order of the days and a strategy of learning them; in the table of results, the
    column `of` holds both, such as `days incremental`. Its metrics are means over the seeds, with a
    point for each step; a step learns a day, or a part of one.
    """
    study = study_runs.study
    rows = pick(study_runs.rows, ask=COURSE)
    rows = rows[np.isfinite(rows["value"])]
    strategies = rows["of"].str.partition(" ")[2].unique().tolist()
    for (course, model), group in rows.groupby(["of", "model"], sort=False):
        order, _, strategy = course.partition(" ")
        labels = {
            "dataset": study.name,
            "grid": study_runs.grid,
            "model": model,
            "order": order,
            "strategy": strategy,
        }
        seeds = group["seed"].unique()
        places = pick(group, number="places").sort_values("at")
        steps = places["sequence"].unique().tolist()
        yield RunRecord(
            name=f"{study_runs.run_name(model)} {order} {strategy}",
            tags={
                COLOUR: PALETTE[strategies.index(strategy) % len(PALETTE)],
                "data": study_runs.data,
                **labels,
            },
            params={
                **labels,
                "train": study.train_text,
                "seeds": len(seeds),
                "budget": study.budget,
            },
            series=step_series(group),
            figures=study_runs.figure_files(model),
            about=filled(
                "course.md.j2",
                **labels,
                steps=steps,
                queried=study.tests,
                seeds=seeds,
                simulated=study.simulated,
            ),
            used=used_sequences(
                _with_steps_as_training(study, steps), study.tests, study_runs.lock
            ),
        )


def _with_steps_as_training(study: Study, steps: Sequence[str]) -> Study:
    """A copy of the study whose training sequences are these steps, for `used_sequences`."""
    sequences = {*study.train, *study.learned, *study.self_training}
    # a step may also be a part of a day, which is no sequence
    return replace(study, train=tuple(step for step in steps if step in sequences))


def of_sweep(
    records: Sequence[Record], defaults: Mapping[str, str], figures: Sequence[Path]
) -> RunRecord:
    """The run of one sweep, named by what was swept, with a child for each job.

    Its own metrics have a point for each job, at the job's number. Settings that are in `defaults`
    are left out.
    """
    first = records[0]
    settings = [
        {name: value for name, value in record.overrides.items() if name not in defaults}
        for record in records
    ]
    names = dict.fromkeys(name for job in settings for name in job)
    # each setting to its values in the order of the jobs, such as "1,2,4"
    swept = {
        name: ",".join(dict.fromkeys(job[name] for job in settings if name in job))
        for name in names
    }
    series = Series()
    for name, key in CHARTED.items():
        for record in records:
            if values := record.values(*key):
                points = series.setdefault(f"sweep/{name}", [])
                points.append((record.number, fmean(values)))
    tags = {
        "dataset": first.dataset,
        "method": first.method,
        "data": "simulated" if first.simulated else "recorded",
    }
    return RunRecord(
        name=f"sweep {_short(swept)}"[:LONGEST_NAME],
        tags=tags,
        params=swept,
        series=series,
        figures=figures,
        children=[_job(record, job, tags) for record, job in zip(records, settings, strict=True)],
    )


def _job(record: Record, settings: Mapping[str, str], tags: Mapping[str, str]) -> RunRecord:
    """The child of a sweep's run that holds one job."""
    failed = {"error": record.error} if record.error else {}
    return RunRecord(
        name=_short(settings) or f"job {record.number}",
        tags={**tags, **failed},
        params=settings,
        series=days_series(record.unperturbed[~record.unperturbed["number"].isin(NOT_OF_JOBS)]),
    )


def _short(values: Mapping[str, str]) -> str:
    """Settings as words, each by the last part of its name: `n_way=4 budget=demo`."""
    return " ".join(f"{name.rpartition('.')[2]}={value}" for name, value in values.items())


def days_series(rows: pd.DataFrame) -> Series:
    """Every metric of unperturbed queries over the days since training, such as `cells/auc_top1`.

    Metrics of other novelty measures have names such as `rejection/energy_auroc`.
    """
    is_shown = np.isfinite(rows["days"]) & (rows["value"].abs() <= LARGEST)
    # skip `*_line`: fitted trend values, covered by `ageing_series`
    rows = rows[is_shown & ~rows["number"].str.endswith("_line")]
    plain = pick(rows, ask=UNPERTURBED)
    groups = plain["number"].map(GROUPS).fillna(plain["protocol"])
    plain_series = _points(plain, groups + "/" + plain["number"], "days")
    novelty = pick(rows, ask=NOVELTY, protocol="cells")
    novelty = novelty[novelty["number"].isin(REJECTION)]
    novelty_names = "rejection/" + novelty["of"] + "_" + novelty["number"].map(REJECTION)
    return plain_series | _points(novelty, novelty_names, "days")


def mean_series(rows: pd.DataFrame) -> Series:
    """The mean of each of MEANS over the test days that have it: a single value, `mean/…`."""
    is_shown = np.isfinite(rows["days"]) & np.isfinite(rows["value"])
    plain = pick(rows[is_shown], ask=UNPERTURBED)
    means = plain.groupby(["protocol", "number"])["value"].mean()
    return {
        f"mean/{protocol}_{name}": [(0, means[protocol, name])]
        for protocol, name in MEANS
        if (protocol, name) in means
    }


def training_series(arrays: Mapping[str, NDArray[Any]]) -> Series:
    """The curves that a model's file holds of its training, over the epochs."""
    return {
        f"train/{name.removeprefix('curves/')}": list(enumerate(map(float, values), start=1))
        for name, values in arrays.items()
        if name.startswith("curves/")
    }


def ageing_series(rows: pd.DataFrame) -> Series:
    """The change of each metric per 100 days with its interval, and when to train again; AwC-FT.

    They are single values at step 0: MLflow draws a metric whose only step is 0 as bars over the
    runs, and any other as a line, which would be a dot.
    """
    # rows over all days have sequence ""
    year_rows = pick(rows, sequence="").set_index(["protocol", "number"])
    series = Series()
    for protocol, number in AGEING:
        name = number if number == PERCENTILE else f"{protocol}_{number}"
        for suffix, columns in (
            ("per_100_days", ("value", "low", "high")),
            ("retrain_after_days", ("value",)),
        ):
            key = (protocol, f"{number}_{suffix}")
            if key not in year_rows.index:
                continue
            for column in columns:
                metric = f"ageing/{name}_{suffix}" + ("" if column == "value" else f"_{column}")
                value = float(year_rows.loc[key, column])
                if np.isfinite(value):
                    series[metric] = [(0, value)]
    for protocol in PROTOCOLS:
        if (protocol, AWC_FT) in year_rows.index:
            area = float(year_rows.loc[(protocol, AWC_FT), "value"])
            if np.isfinite(area):
                series[f"ageing/{protocol}_{AWC_FT}"] = [(0, area)]
    return series


def viewpoint_series(rows: pd.DataFrame) -> Series:
    """Metrics of queries seen from other headings, over the heading, truncated to whole degrees.

    The protocol is that of Yin et al., "Stabilize an Unsupervised Feature Learning for LiDAR-based
    Place Recognition" (IROS 2018).
    """
    turned = pick(rows[np.isfinite(rows["value"])], of=HEADING)
    names = "viewpoints/" + turned["number"] + " " + turned["sequence"]
    return _points(turned, names, "at")  # `at` is the heading


def step_series(rows: pd.DataFrame) -> Series:
    """Each metric of a course over its steps: the mean over the seeds.

    The recall@1 of each queried day, or part of the site, is in a group of its own.
    """
    # rows without a protocol are costs, such as the number of places
    plain_names = rows["protocol"].replace("", "cost") + "/" + rows["number"]
    query_day_names = "recall_by_" + rows["protocol"] + "/" + rows["sequence"]
    names = plain_names.where(rows["number"] != "recall_at_1", query_day_names)
    averaged = rows.assign(metric=names).groupby(["metric", "at"])["value"].mean().reset_index()
    return _points(averaged, averaged["metric"], "at")  # `at` is the step


def _points(rows: pd.DataFrame, names: pd.Series, step_column: str) -> Series:
    """The points of each metric: its values over the steps, which are truncated to integers."""
    series = {}
    for name, group in rows.groupby(names):
        steps = group[step_column].astype(int).tolist()
        series[name] = sorted(zip(steps, group["value"].tolist(), strict=True))
    return series


def stage_costs(layout: Layout, study: str, grid: str, method: StudyMethod, model: Path) -> Series:
    """The costs of a method's stages and the trace of its training, if they ran here."""
    trace = Trace.read(model)
    measured = costs(
        {
            "views": [layout.path("views", study, method.view)],
            "train": [model],
            "localize": [layout.path("localize", study, grid, method.name)],
            "evaluate": [layout.path("evaluate", study, grid, method.name)],
        }
    )
    series = {f"cost/{name}": [(0, value)] for name, value in measured.items()}
    return series | (trace.series() if trace else {})
