"""Builds the runs that MLflow shows, from the table of results.

One run for each method, with a child run for each day; one for each sweep, with a child run for
each job.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError
from pipeline.evaluation.rows import table
from pipeline.evaluation.study_rows import AGEING
from pipeline.running.dvc_files import DvcLock
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.catalogue import what
from pipeline.studies.colours import colour, darker
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study, StudyMethod
from pipeline.sweeps.record import Record
from pipeline.tracking.datasets import used_sequences
from pipeline.tracking.page import COLOUR
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.served import Served
from pipeline.tracking.texts import filled

CHARTED = {
    "cells_auc_top1": ("cells", "auc_top1"),
    "cells_recall_at_1": ("cells", "recall_at_1"),
    "distance_recall_at_1": ("distance", "recall_at_1"),
    "held_out_auc": ("cells", "held_out_auc"),
}
"""What the parent of a sweep charts of each job: a metric's name to the protocol and number whose
mean over the tests it is."""
NOT_OF_JOBS = ("queries", "turned_share")
"""Numbers that MLflow shows of a method's run and not of a sweep's job."""
REJECTION = {
    "auroc": "auroc",
    "precision_at_threshold": "precision",
    "recall_at_threshold": "recall",
}
"""What is charted of each kind of novelty, by cells, and the end of the metric's name."""
BELIEF = ("accepted", "accepted_wrong", "refused", "refused_wrong")
GROUPS = {
    **dict.fromkeys(BELIEF, "accepted"),
    "ece": "calibration",
    "ece_raw": "calibration",
    "novelty_percentile": "ageing",
}
"""The group that a number is charted in, instead of its protocol's.

MLflow lists a run's metrics by name: what is believed comes first.
"""
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
"""Protocol and number whose mean over the test days the run of a method holds: MLflow's table of
runs shows a last value."""
LARGEST = 1e30  # a threshold beyond rejects nothing
Series = dict[str, list[tuple[int, float]]]


@dataclass(frozen=True)
class Source:
    """The study, table and figures that the runs of one study and grid are published from."""

    study: Study
    grid: str
    rows: pd.DataFrame  # of the table of results, of this study and grid
    figures: Path  # folder of the report's figures, with its list of whose they are
    lock: DvcLock = field(
        default_factory=lambda: DvcLock({})
    )  # where the digests of its sequences come from

    def record(
        self,
        answerer: ModelName,
        arrays: Mapping[str, NDArray[Any]],
        recipe: Mapping[str, str],
        extra: Series,
    ) -> RunRecord:
        """The run of a method, or of its answers with poses, with a child a test sequence.

        Its metrics are those over the days, ageing, curves of training, and `extra`.
        """
        rows = self.rows
        model = answerer.family
        model_rows = rows[
            (rows["method"] == answerer.method)
            & (rows["variant"] == answerer.answered)
            & (rows["seed"] == 0)
        ]
        place = {"dataset": self.study.name, "grid": self.grid}
        tint = colour(model)
        tags = {COLOUR: darker(tint) if answerer.answered else tint, **place, "method": model}
        tags["data"] = "simulated" if self.study.simulated else "recorded"
        params = {**place, "train": self.study.train_text, **recipe}
        rows_as_driven = model_rows[(model_rows["change"] == "") & (model_rows["stress"] == "")]
        curves = {
            f"train/{name.removeprefix('curves/')}": list(enumerate(map(float, values), start=1))
            for name, values in arrays.items()
            if name.startswith("curves/")
        }
        children = []
        for test in self.study.tests:
            day = rows_as_driven[rows_as_driven["sequence"] == test]
            files = self.files(model, test)
            day_tags = tags | {"sequence": test}
            about = self._about("day.md.j2", sequence=test, days=_days(day))
            inputs = used_sequences(self.study, [test], self.lock, train=False)
            children.append(
                RunRecord(
                    test,
                    day_tags,
                    params | {"test": test},
                    over_days(day),
                    files,
                    about=about,
                    used=inputs,
                )
            )
        test_rows = rows_as_driven[rows_as_driven["sequence"].isin(self.study.tests)]
        series = (
            over_days(test_rows)
            | means(test_rows)
            | curves
            | ageing(rows_as_driven)
            | viewpoints(model_rows)
            | extra
        )
        places = len(arrays["place_xy_m"]) if "place_xy_m" in arrays else 0
        run_values = {
            "what": what(recipe.get("_target_", "")),
            "method": model,
            "share": recipe.get("budget", ""),
            "places": places,
        }
        about = self._about("run.md.j2", **run_values)
        registered = "" if answerer.posed else self._registered(model)
        inputs = used_sequences(self.study, self.study.tests, self.lock)
        return RunRecord(
            self.run(model),
            tags,
            params,
            series,
            self.files(model),
            children,
            None,
            registered,
            about,
            inputs,
        )

    def run(self, model: str) -> str:
        """The name of a model's run, with the grid where the study has several.

        Short, since a chart's legend has two lines for all runs.
        """
        return model if self.study.grid_names == [self.grid] else f"{model} {self.grid}"

    def _registered(self, model: str) -> str:
        """The name of the method's model in the registry, such as campus-sci-simulated."""
        return "-".join(
            [self.study.name, *self.run(model).split()] + ["simulated"] * self.study.simulated
        )

    def _about(self, template: str, **values: Any) -> str:
        study_values = {
            "study": self.study.name,
            "grid": self.grid,
            "simulated": self.study.simulated,
            "train": self.study.train_text,
            "tests": self.study.tests,
            "budget": self.study.budget,
        }
        return filled(template, **study_values | values)

    def files(self, model: str, sequence: str = "") -> list[Path]:
        """The figures of a model, with those of all models; or its figures on one test sequence.

        Raises ArtifactError where there is no report: DVC removes the old one before it writes
        another.
        """
        manifest = self.figures / "figures.json"
        if not manifest.is_file():
            raise ArtifactError(f"{self.figures}: no report yet; `dvc repro` writes it")
        entries = json.loads(manifest.read_text(encoding="utf-8"))
        owners = {model} if sequence else {model, ""}
        names = [
            entry["file"]
            for entry in entries
            if entry["sequence"] == sequence and entry["model"] in owners
        ]
        return [self.figures / file for file in dict.fromkeys(names)]


def over_days(rows: pd.DataFrame) -> Series:
    """Every number of some sequences over the days, named as MLflow groups: `cells/auc_top1`."""
    rows = rows[
        np.isfinite(rows["days"])
        & (rows["value"].abs() <= LARGEST)
        & ~rows["number"].str.endswith("_line")
    ]
    plain_rows = rows[rows["kind"] == ""]
    kinds = rows[(rows["kind"] != "") & (rows["protocol"] == "cells")]
    kinds = kinds[kinds["number"].isin(REJECTION)]
    names = (
        plain_rows["number"].map(GROUPS).fillna(plain_rows["protocol"]) + "/" + plain_rows["number"]
    )
    of_kinds = "rejection/" + kinds["kind"] + "_" + kinds["number"].map(REJECTION)
    return _points(plain_rows, names, "days") | _points(kinds, of_kinds, "days")


def means(rows: pd.DataFrame) -> Series:
    """The mean of each of MEANS over the test days that have it, as the one value of `mean/…`."""
    plain_rows = rows[(rows["kind"] == "") & np.isfinite(rows["days"]) & np.isfinite(rows["value"])]
    mean = plain_rows.groupby(["protocol", "number"])["value"].mean()
    return {
        f"mean/{protocol}_{number}": [(0, mean[protocol, number])]
        for protocol, number in MEANS
        if (protocol, number) in mean
    }


def ageing(rows: pd.DataFrame) -> Series:
    """The change of each number per 100 days with its interval, and when to train again.

    Single values, at step 0: MLflow draws a metric whose only step is 0 as bars over the runs, any
    other as a line, which would be a dot.
    """
    study_rows = rows[rows["sequence"] == ""]
    series = Series()
    numbers = study_rows.set_index(["protocol", "number"])[["value", "low", "high"]]
    for protocol, number in AGEING:
        name = number if number == "novelty_percentile" else f"{protocol}_{number}"
        for end, bounds in (("per_100_days", ("", "_low", "_high")), ("retrain_after_days", ("",))):
            if (protocol, f"{number}_{end}") in numbers.index:
                values = zip(bounds, numbers.loc[(protocol, f"{number}_{end}")], strict=False)
                series |= {
                    f"ageing/{name}_{end}{bound}": [(0, float(v))]
                    for bound, v in values
                    if np.isfinite(v)
                }
    return series


def viewpoints(rows: pd.DataFrame) -> Series:
    """Numbers on turned queries, over whole degrees of heading."""
    viewpoint_rows = rows[(rows["change"] == "viewpoint") & np.isfinite(rows["value"])]
    return _points(
        viewpoint_rows,
        "viewpoints/" + viewpoint_rows["number"] + " " + viewpoint_rows["sequence"],
        "level",
    )


def _days(rows: pd.DataFrame) -> int | None:
    """Days since training of one sequence's rows; None where there are none."""
    days = rows["days"].dropna()
    return int(days.iloc[0]) if len(days) else None


def _points(rows: pd.DataFrame, names: pd.Series, step: str) -> Series:
    """The values of each metric over a column, cut to whole numbers."""
    return {
        name: sorted(zip(group[step].astype(int).tolist(), group["value"].tolist(), strict=True))
        for name, group in rows.groupby(names)
    }


def stage_costs(layout: Layout, study: str, grid: str, method: StudyMethod, model: Path) -> Series:
    """The costs of a method's stages and the trace of its training, where they ran here."""
    views = layout.path("views", study, method.view)
    stages = {"views": [views], "train": [model]}
    stages |= {
        stage: [layout.path(stage, study, grid, method.name)] for stage in ("localize", "evaluate")
    }
    trace = Trace.read(model)
    return {f"cost/{name}": [(0, value)] for name, value in costs(stages).items()} | (
        trace.series() if trace else {}
    )


def with_model(record: RunRecord, arrays: Path) -> RunRecord:
    """The run with its model, where the model's recipe names its class."""
    return replace(record, model=Served.read(arrays))


def of_sweep(
    records: Sequence[Record], defaults: Mapping[str, str], figures: Sequence[Path]
) -> RunRecord:
    """The run of one sweep, named by what was swept.

    The steps of the parent's own metrics are the jobs' numbers.
    """
    first = records[0]
    overrides_of = {
        record.number: {
            key: value for key, value in record.overrides.items() if key not in defaults
        }
        for record in records
    }
    names = dict.fromkeys(name for overrides in overrides_of.values() for name in overrides)
    values = {
        name: ",".join(
            dict.fromkeys(
                overrides[name] for overrides in overrides_of.values() if name in overrides
            )
        )
        for name in names
    }
    tags = {
        "dataset": first.dataset,
        "method": first.method,
        "data": "simulated" if first.simulated else "recorded",
    }
    series = {
        f"sweep/{name}": [
            (record.number, fmean(test_values))
            for record in records
            if (test_values := record.values(*number))
        ]
        for name, number in CHARTED.items()
    }
    children = []
    for record in records:
        name = _short(overrides_of[record.number]) or f"job {record.number}"
        rows = table(record.rows)
        job_series = over_days(rows[(rows["kind"] == "") & ~rows["number"].isin(NOT_OF_JOBS)])
        children.append(
            RunRecord(
                name,
                tags | ({"error": record.error} if record.error else {}),
                overrides_of[record.number],
                job_series,
            )
        )
    return RunRecord(
        f"sweep {_short(values)}"[:240],
        tags,
        values,
        {k: v for k, v in series.items() if v},
        figures,
        children,
    )


def _short(values: Mapping[str, str]) -> str:
    return " ".join(f"{name.rpartition('.')[2]}={value}" for name, value in values.items())
