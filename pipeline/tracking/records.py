"""The runs that MLflow shows, from the table of results: a run a method, a child run a day; a sweep and its jobs."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.study_rows import AGEING
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.colours import colour
from pipeline.sweeps.record import Record
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.served import Served

CHARTED = (("cells", "auc_top1"), ("cells", "recall_at_1"), ("distance", "recall_at_1"))
"""What the parent of a sweep charts of each job: protocol and number, as the mean over the test sequences."""
REJECTION = {"auroc": "auroc", "precision_at_threshold": "precision", "recall_at_threshold": "recall"}
"""What is charted of each kind of novelty, by cells, and the end of the metric's name."""
Series = dict[str, list[tuple[int, float]]]


@dataclass(frozen=True)
class Source:
    """What the runs of one study and grid are published from."""

    study: str
    grid: str
    words: Mapping[str, Any]
    """Of conf/studies.yaml."""
    simulated: bool
    rows: pd.DataFrame
    """Of the table of results, of this study and grid."""
    figures: Path
    """Folder of the report's figures, with its list of whose they are."""

    def record(self, model: str, arrays: Mapping[str, NDArray[Any]], recipe: Mapping[str, str], extra: Series) -> RunRecord:
        """A method's run: its metrics over the days, ageing, curves of training and `extra`, and a child a test sequence."""
        own = self.rows[(self.rows["method"] == model) & (self.rows["variant"] == "") & (self.rows["seed"] == 0)]
        tags = {"mlflow.runColor": colour(model), "dataset": self.study, "grid": self.grid, "method": model}
        tags["data"] = "simulated" if self.simulated else "recorded"
        params = {"dataset": self.study, "grid": self.grid, "train": self.words["train"], **recipe}
        driven = own[(own["change"] == "") & (own["stress"] == "")]
        curves = {
            f"train/{name.removeprefix('curves/')}": list(enumerate(map(float, values), start=1))
            for name, values in arrays.items()
            if name.startswith("curves/")
        }
        children = [
            RunRecord(
                sequence,
                tags | {"sequence": sequence},
                params | {"test": sequence},
                over_days(driven[driven["sequence"] == sequence]),
                self._files(model, sequence),
            )
            for sequence in self.words["tests"]
        ]
        series = (
            over_days(driven[driven["sequence"].isin(self.words["tests"])]) | curves | ageing(driven) | viewpoints(own) | extra
        )
        return RunRecord(f"{model} {self.grid}", tags, params, series, self._files(model), children)

    def _files(self, model: str, sequence: str = "") -> list[Path]:
        """The figures that belong to a model, those of all models included; or to it on one test sequence."""
        listed, owners = json.loads((self.figures / "figures.json").read_text()), {model} if sequence else {model, ""}
        wanted = [one["file"] for one in listed if one["sequence"] == sequence and one["model"] in owners]
        return [self.figures / file for file in dict.fromkeys(wanted)]


def over_days(rows: pd.DataFrame) -> Series:
    """Every number of some sequences over the days, under names that MLflow groups, such as `cells/auc_top1`."""
    found: Series = {}
    for number, protocol, kind, days, value in rows[["number", "protocol", "kind", "days", "value"]].itertuples(index=False):
        if not (np.isfinite(value) and np.isfinite(days)) or number.endswith("_line") or abs(value) > 1e30:
            continue
        if kind:
            name = f"rejection/{kind}_{REJECTION[number]}" if number in REJECTION and protocol == "cells" else ""
        else:
            group = {"ece": "calibration", "ece_raw": "calibration", "novelty_percentile": "ageing"}.get(number, protocol)
            name = f"{group}/{number}"
        if name:
            found.setdefault(name, []).append((int(days), float(value)))
    return {name: sorted(points) for name, points in found.items()}


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
    own, found = rows[(rows["change"] == "viewpoint") & np.isfinite(rows["value"])], Series()
    for number, sequence, level, value in own[["number", "sequence", "level", "value"]].itertuples(index=False):
        found.setdefault(f"viewpoints/{number} {sequence}", []).append((int(level), float(value)))
    return {name: sorted(points) for name, points in found.items()}


def measured(artifacts: Path, study: str, grid: str, method: Mapping[str, Any], model: Path) -> Series:
    """What the stages of a method cost, and how its training used the machine, where they ran here."""
    views = artifacts / "views" / study / method["view"]
    stages = {"views": [views], "train": [model]}
    stages |= {stage: [artifacts / stage / study / grid / method["name"]] for stage in ("localize", "evaluate")}
    trace = Trace.read(model)
    return {f"cost/{name}": [(0, value)] for name, value in costs(stages).items()} | (trace.series() if trace else {})


def with_model(record: RunRecord, arrays: Path) -> RunRecord:
    """The same with its model, where its recipe names its class."""
    return RunRecord(record.name, record.tags, record.params, record.series, record.figures, record.children, Served.read(arrays))


def of_sweep(records: Sequence[Record], usual: Mapping[str, str], figures: Sequence[Path]) -> RunRecord:
    """One sweep, named by what was swept; the steps of the parent's own metrics are the jobs' numbers."""
    first = records[0]
    own = {one.number: {key: value for key, value in one.overrides.items() if key not in usual} for one in records}
    names = dict.fromkeys(name for overrides in own.values() for name in overrides)
    values = {name: ",".join(dict.fromkeys(overrides[name] for overrides in own.values() if name in overrides)) for name in names}
    tags = {"dataset": first.dataset, "method": first.method, "data": "simulated" if first.simulated else "recorded"}
    series = {f"sweep/{protocol}_{name}": list(_means(records, protocol, name)) for protocol, name in CHARTED}
    series["sweep/held_out_auc"] = [(one.number, one.held_out_auc) for one in records if one.held_out_auc is not None]
    children = [
        RunRecord(
            _short(own[one.number]) or f"job {one.number}",
            tags | ({"error": one.error} if one.error else {}),
            own[one.number],
            _over_days(one),
        )
        for one in records
    ]
    return RunRecord(f"sweep {_short(values)}"[:240], tags, values, {k: v for k, v in series.items() if v}, figures, children)


def _means(records: Sequence[Record], protocol: str, name: str) -> Iterator[tuple[int, float]]:
    for one in records:
        values = [numbers[protocol][name] for numbers in (one.numbers or {}).values() if numbers[protocol][name] is not None]
        if values:
            yield one.number, float(np.mean(values))


def _short(values: Mapping[str, str]) -> str:
    return " ".join(f"{name.rpartition('.')[2]}={value}" for name, value in values.items())


def _over_days(record: Record) -> Series:
    """Every number of a job that there is, under the names that a study's runs have."""
    series: Series = {}
    for numbers in (record.numbers or {}).values():
        for group in ("cells", "distance", "calibration"):
            for name, value in numbers[group].items():
                if value is not None and np.isfinite(value) and abs(value) < 1e30:
                    series.setdefault(f"{group}/{name}", []).append((int(numbers["days"]), float(value)))
    return series
