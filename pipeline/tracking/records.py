"""The runs that MLflow shows, from the table of results: a run a method, a child run a day; a sweep
and its jobs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.errors import ArtifactError
from pipeline.evaluation.rows import table
from pipeline.evaluation.study_rows import AGEING
from pipeline.running.dvc_files import DvcLock
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.catalogue import what
from pipeline.studies.colours import colour, darker
from pipeline.studies.expansion import ModelName
from pipeline.sweeps.record import Record
from pipeline.tracking.datasets import used
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
GROUPS = {"ece": "calibration", "ece_raw": "calibration", "novelty_percentile": "ageing"}
"""Of numbers that are not charted under their protocol."""
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
    """What the runs of one study and grid are published from."""

    study: str
    grid: str
    words: Mapping[str, Any]  # of conf/studies.yaml
    simulated: bool
    rows: pd.DataFrame  # of the table of results, of this study and grid
    figures: Path  # folder of the report's figures, with its list of whose they are
    lock: DvcLock = field(
        default_factory=lambda: DvcLock({})
    )  # where the digests of its sequences come from

    def record(
        self,
        of: ModelName,
        arrays: Mapping[str, NDArray[Any]],
        recipe: Mapping[str, str],
        extra: Series,
    ) -> RunRecord:
        """The run of a method, or of what answers with its poses: its metrics over the days,
        ageing, curves of training and `extra`, and a child a test sequence."""
        rows = self.rows
        model = of.family
        own = rows[
            (rows["method"] == of.method) & (rows["variant"] == of.answered) & (rows["seed"] == 0)
        ]
        where = {"dataset": self.study, "grid": self.grid}
        tint = colour(model)
        tags = {COLOUR: darker(tint) if of.answered else tint, **where, "method": model}
        tags["data"] = "simulated" if self.simulated else "recorded"
        params = {**where, "train": self.words["train"], **recipe}
        driven = own[(own["change"] == "") & (own["stress"] == "")]
        curves = {
            f"train/{name.removeprefix('curves/')}": list(enumerate(map(float, values), start=1))
            for name, values in arrays.items()
            if name.startswith("curves/")
        }
        children = []
        for test in self.words["tests"]:
            day = driven[driven["sequence"] == test]
            files = self.files(model, test)
            name = tags | {"sequence": test}
            about = self._about("day.md.j2", sequence=test, days=_days(day))
            inputs = used(self.study, self.words, [test], self.lock, train=False)
            children.append(
                RunRecord(
                    test,
                    name,
                    params | {"test": test},
                    over_days(day),
                    files,
                    about=about,
                    used=inputs,
                )
            )
        tested = driven[driven["sequence"].isin(self.words["tests"])]
        series = (
            over_days(tested) | means(tested) | curves | ageing(driven) | viewpoints(own) | extra
        )
        places = len(arrays["place_xy_m"]) if "place_xy_m" in arrays else 0
        said = {
            "what": what(recipe.get("_target_", "")),
            "method": model,
            "share": recipe.get("budget", ""),
            "places": places,
        }
        about = self._about("run.md.j2", **said)
        registered = "" if of.posed else self._registered(model)
        inputs = used(self.study, self.words, self.words["tests"], self.lock)
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
        """With the grid where the study has several; short, since a chart's legend has two lines
        for all runs."""
        return model if [*self.words.get("grids", ())] == [self.grid] else f"{model} {self.grid}"

    def _registered(self, model: str) -> str:
        """The name of the method's model in the registry, such as campus-sci-simulated."""
        return "-".join([self.study, *self.run(model).split()] + ["simulated"] * self.simulated)

    def _about(self, template: str, **values: Any) -> str:
        own = {
            "study": self.study,
            "grid": self.grid,
            "simulated": self.simulated,
            "budget": "",
            **self.words,
        }
        return filled(template, **own | values)

    def files(self, model: str, sequence: str = "") -> list[Path]:
        """The figures that belong to a model, those of all models included; or to it on one test
        sequence.

        Raises ArtifactError where the report is not there: DVC removes the old one before it writes
        another.
        """
        manifest = self.figures / "figures.json"
        if not manifest.is_file():
            raise ArtifactError(f"{self.figures}: no report yet; `dvc repro` writes it")
        listed = json.loads(manifest.read_text(encoding="utf-8"))
        owners = {model} if sequence else {model, ""}
        wanted = [
            one["file"] for one in listed if one["sequence"] == sequence and one["model"] in owners
        ]
        return [self.figures / file for file in dict.fromkeys(wanted)]


def over_days(rows: pd.DataFrame) -> Series:
    """Every number of some sequences over the days, under names that MLflow groups, such as
    `cells/auc_top1`."""
    rows = rows[
        np.isfinite(rows["days"])
        & (rows["value"].abs() <= LARGEST)
        & ~rows["number"].str.endswith("_line")
    ]
    plain = rows[rows["kind"] == ""]
    kinds = rows[(rows["kind"] != "") & (rows["protocol"] == "cells")]
    kinds = kinds[kinds["number"].isin(REJECTION)]
    names = plain["number"].map(GROUPS).fillna(plain["protocol"]) + "/" + plain["number"]
    of_kinds = "rejection/" + kinds["kind"] + "_" + kinds["number"].map(REJECTION)
    return _points(plain, names, "days") | _points(kinds, of_kinds, "days")


def means(rows: pd.DataFrame) -> Series:
    """The mean of each of MEANS over the test days that have the number, as the one value of
    `mean/…`."""
    plain = rows[(rows["kind"] == "") & np.isfinite(rows["days"]) & np.isfinite(rows["value"])]
    found = plain.groupby(["protocol", "number"])["value"].mean()
    return {
        f"mean/{protocol}_{number}": [(0, found[protocol, number])]
        for protocol, number in MEANS
        if (protocol, number) in found
    }


def ageing(rows: pd.DataFrame) -> Series:
    """The change of each number per 100 days with its interval, and when to train again: single
    values, at step 0.

    MLflow draws a metric whose only step is 0 as bars over the runs, any other as a line, which
    would be a dot.
    """
    whole = rows[rows["sequence"] == ""]
    found = Series()
    known = whole.set_index(["protocol", "number"])[["value", "low", "high"]]
    for protocol, number in AGEING:
        name = number if number == "novelty_percentile" else f"{protocol}_{number}"
        for end, bounds in (("per_100_days", ("", "_low", "_high")), ("retrain_after_days", ("",))):
            if (protocol, f"{number}_{end}") in known.index:
                values = zip(bounds, known.loc[(protocol, f"{number}_{end}")], strict=False)
                found |= {
                    f"ageing/{name}_{end}{bound}": [(0, float(v))]
                    for bound, v in values
                    if np.isfinite(v)
                }
    return found


def viewpoints(rows: pd.DataFrame) -> Series:
    """How a method bears being turned, over whole degrees of heading."""
    own = rows[(rows["change"] == "viewpoint") & np.isfinite(rows["value"])]
    return _points(own, "viewpoints/" + own["number"] + " " + own["sequence"], "level")


def _days(rows: pd.DataFrame) -> int | None:
    """Days since training of one sequence's rows; None where there are none."""
    days = rows["days"].dropna()
    return int(days.iloc[0]) if len(days) else None


def _points(rows: pd.DataFrame, names: pd.Series, step: str) -> Series:
    """The values of each metric over a column, cut to whole numbers."""
    return {
        name: sorted(zip(own[step].astype(int).tolist(), own["value"].tolist(), strict=True))
        for name, own in rows.groupby(names)
    }


def measured(
    artifacts: Path, study: str, grid: str, method: Mapping[str, Any], model: Path
) -> Series:
    """What the stages of a method cost, and how its training used the machine, where they ran
    here."""
    views = artifacts / "views" / study / method["view"]
    stages = {"views": [views], "train": [model]}
    stages |= {
        stage: [artifacts / stage / study / grid / method["name"]]
        for stage in ("localize", "evaluate")
    }
    trace = Trace.read(model)
    return {f"cost/{name}": [(0, value)] for name, value in costs(stages).items()} | (
        trace.series() if trace else {}
    )


def with_model(record: RunRecord, arrays: Path) -> RunRecord:
    """The same with its model, where its recipe names its class."""
    return replace(record, model=Served.read(arrays))


def of_sweep(
    records: Sequence[Record], usual: Mapping[str, str], figures: Sequence[Path]
) -> RunRecord:
    """One sweep, named by what was swept; the steps of the parent's own metrics are the jobs'
    numbers."""
    first = records[0]
    own = {
        one.number: {key: value for key, value in one.overrides.items() if key not in usual}
        for one in records
    }
    names = dict.fromkeys(name for overrides in own.values() for name in overrides)
    values = {
        name: ",".join(
            dict.fromkeys(overrides[name] for overrides in own.values() if name in overrides)
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
            (one.number, fmean(found)) for one in records if (found := one.values(*number))
        ]
        for name, number in CHARTED.items()
    }
    children = []
    for one in records:
        name = _short(own[one.number]) or f"job {one.number}"
        rows = table(one.rows)
        driven = over_days(rows[(rows["kind"] == "") & ~rows["number"].isin(NOT_OF_JOBS)])
        children.append(
            RunRecord(
                name, tags | ({"error": one.error} if one.error else {}), own[one.number], driven
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
