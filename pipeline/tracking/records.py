"""The runs that MLflow shows, from the table of results: a run a method, a child run a day; a sweep and its jobs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.rows import table
from pipeline.evaluation.study_rows import AGEING
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.colours import colour
from pipeline.sweeps.record import Record
from pipeline.tracking.page import COLOUR
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.served import Served

CHARTED = {
    "cells_auc_top1": ("cells", "auc_top1"),
    "cells_recall_at_1": ("cells", "recall_at_1"),
    "distance_recall_at_1": ("distance", "recall_at_1"),
    "held_out_auc": ("cells", "held_out_auc"),
}
"""What the parent of a sweep charts of each job: a metric's name to the protocol and number whose mean over the tests it is."""
NOT_OF_JOBS = ("queries", "turned_share")
"""Numbers that MLflow shows of a method's run and not of a sweep's job."""
REJECTION = {"auroc": "auroc", "precision_at_threshold": "precision", "recall_at_threshold": "recall"}
"""What is charted of each kind of novelty, by cells, and the end of the metric's name."""
GROUPS = {"ece": "calibration", "ece_raw": "calibration", "novelty_percentile": "ageing"}
"""Of numbers that are not charted under their protocol."""
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

    def record(self, model: str, arrays: Mapping[str, NDArray[Any]], recipe: Mapping[str, str], extra: Series) -> RunRecord:
        """A method's run: its metrics over the days, ageing, curves of training and `extra`, and a child a test sequence."""
        own = self.rows[(self.rows["method"] == model) & (self.rows["variant"] == "") & (self.rows["seed"] == 0)]
        where = {"dataset": self.study, "grid": self.grid}
        tags = {COLOUR: colour(model), **where, "method": model, "data": "simulated" if self.simulated else "recorded"}
        params, driven = {**where, "train": self.words["train"], **recipe}, own[(own["change"] == "") & (own["stress"] == "")]
        curves = {
            f"train/{name.removeprefix('curves/')}": list(enumerate(map(float, values), start=1))
            for name, values in arrays.items()
            if name.startswith("curves/")
        }
        children = []
        for test in self.words["tests"]:
            series, files = over_days(driven[driven["sequence"] == test]), self._files(model, test)
            children.append(RunRecord(test, tags | {"sequence": test}, params | {"test": test}, series, files))
        series = over_days(driven[driven["sequence"].isin(self.words["tests"])])
        series |= curves | ageing(driven) | viewpoints(own) | extra
        return RunRecord(f"{model} {self.grid}", tags, params, series, self._files(model), children)

    def _files(self, model: str, sequence: str = "") -> list[Path]:
        """The figures that belong to a model, those of all models included; or to it on one test sequence."""
        listed, owners = json.loads((self.figures / "figures.json").read_text()), {model} if sequence else {model, ""}
        wanted = [one["file"] for one in listed if one["sequence"] == sequence and one["model"] in owners]
        return [self.figures / file for file in dict.fromkeys(wanted)]


def over_days(rows: pd.DataFrame) -> Series:
    """Every number of some sequences over the days, under names that MLflow groups, such as `cells/auc_top1`."""
    rows = rows[np.isfinite(rows["days"]) & (rows["value"].abs() <= LARGEST) & ~rows["number"].str.endswith("_line")]
    plain, kinds = rows[rows["kind"] == ""], rows[(rows["kind"] != "") & (rows["protocol"] == "cells")]
    kinds = kinds[kinds["number"].isin(REJECTION)]
    names = plain["number"].map(GROUPS).fillna(plain["protocol"]) + "/" + plain["number"]
    of_kinds = "rejection/" + kinds["kind"] + "_" + kinds["number"].map(REJECTION)
    return _points(plain, names, "days") | _points(kinds, of_kinds, "days")


def ageing(rows: pd.DataFrame) -> Series:
    """The change of each number per 100 days with its interval, and when to train again, at the last day."""
    whole, last, found = rows[rows["sequence"] == ""], rows["days"].max(), Series()
    known = whole.set_index(["protocol", "number"])[["value", "low", "high"]]
    for protocol, number in AGEING:
        name = number if number == "novelty_percentile" else f"{protocol}_{number}"
        for end, bounds in (("per_100_days", ("", "_low", "_high")), ("retrain_after_days", ("",))):
            if (protocol, f"{number}_{end}") in known.index:
                values = zip(bounds, known.loc[(protocol, f"{number}_{end}")], strict=False)
                found |= {f"ageing/{name}_{end}{bound}": [(int(last), float(v))] for bound, v in values if np.isfinite(v)}
    return found


def viewpoints(rows: pd.DataFrame) -> Series:
    """How a method bears being turned, over whole degrees of heading."""
    own = rows[(rows["change"] == "viewpoint") & np.isfinite(rows["value"])]
    return _points(own, "viewpoints/" + own["number"] + " " + own["sequence"], "level")


def _points(rows: pd.DataFrame, names: pd.Series, step: str) -> Series:
    """The values of each metric over a column, cut to whole numbers."""
    return {
        name: sorted(zip(own[step].astype(int).tolist(), own["value"].tolist(), strict=True)) for name, own in rows.groupby(names)
    }


def measured(artifacts: Path, study: str, grid: str, method: Mapping[str, Any], model: Path) -> Series:
    """What the stages of a method cost, and how its training used the machine, where they ran here."""
    views = artifacts / "views" / study / method["view"]
    stages = {"views": [views], "train": [model]}
    stages |= {stage: [artifacts / stage / study / grid / method["name"]] for stage in ("localize", "evaluate")}
    trace = Trace.read(model)
    return {f"cost/{name}": [(0, value)] for name, value in costs(stages).items()} | (trace.series() if trace else {})


def with_model(record: RunRecord, arrays: Path) -> RunRecord:
    """The same with its model, where its recipe names its class."""
    return replace(record, model=Served.read(arrays))


def of_sweep(records: Sequence[Record], usual: Mapping[str, str], figures: Sequence[Path]) -> RunRecord:
    """One sweep, named by what was swept; the steps of the parent's own metrics are the jobs' numbers."""
    first = records[0]
    own = {one.number: {key: value for key, value in one.overrides.items() if key not in usual} for one in records}
    names = dict.fromkeys(name for overrides in own.values() for name in overrides)
    values = {name: ",".join(dict.fromkeys(overrides[name] for overrides in own.values() if name in overrides)) for name in names}
    tags = {"dataset": first.dataset, "method": first.method, "data": "simulated" if first.simulated else "recorded"}
    series = {
        f"sweep/{name}": [(one.number, fmean(found)) for one in records if (found := one.values(*number))]
        for name, number in CHARTED.items()
    }
    children = []
    for one in records:
        name, rows = _short(own[one.number]) or f"job {one.number}", table(one.rows)
        driven = over_days(rows[(rows["kind"] == "") & ~rows["number"].isin(NOT_OF_JOBS)])
        children.append(RunRecord(name, tags | ({"error": one.error} if one.error else {}), own[one.number], driven))
    return RunRecord(f"sweep {_short(values)}"[:240], tags, values, {k: v for k, v in series.items() if v}, figures, children)


def _short(values: Mapping[str, str]) -> str:
    return " ".join(f"{name.rpartition('.')[2]}={value}" for name, value in values.items())
