"""A study as the runs that MLflow shows."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.numbers import NUMBERS
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports import ageing_lines, gallery
from pipeline.reports.rejection import of
from pipeline.reports.result import Result
from pipeline.reports.table import present
from pipeline.tracking.runs import RunRecord

if TYPE_CHECKING:
    from pipeline.reports.study import Study

REJECTION = {"auroc": "auroc", "precision": "precision_at_threshold", "recall": "recall_at_threshold"}
"""What is charted of each kind of novelty, by cells: the end of the metric's name and the measure."""


def record(study: "Study", method: str, group: Sequence[Result], figures: Path, colour: str) -> RunRecord:
    """One method's run: its metrics over the days and their slopes, how it was learned, and a child run a test sequence."""
    tags = {"mlflow.runColor": colour, "dataset": study.dataset, "grid": study.grid, "method": method}
    tags["data"] = "simulated" if study.simulated else "recorded"
    params = {"dataset": study.dataset, "cell_m": study.cell_m, "train": study.train, **study.recipes[method]}
    series: dict[str, list[tuple[int, float]]] = {}
    for result in group:
        for name, value in metrics(result).items():
            series.setdefault(name, []).append((result.days, value))
    learned = {
        f"train/{name}": list(enumerate(map(float, column), start=1)) for name, column in study.models[method].curves.items()
    }
    children = [
        RunRecord(
            result.sequence,
            tags | {"sequence": result.sequence},
            params | {"test": result.sequence},
            {name: [(result.days, value)] for name, value in metrics(result).items()},
            gallery.files(study, figures, method, result.sequence),
        )
        for result in group
    ]
    aged = ageing_lines.series(group, ageing_lines.held_out(study.find, group), Ageing())
    return RunRecord(
        f"{method} {study.grid}", tags, params, series | learned | aged, gallery.files(study, figures, method), children
    )


def metrics(result: Result) -> Mapping[str, float]:
    """Every number of one result that there is, under names that MLflow groups: `cells/auc_top1`, `rejection/energy_auroc`."""
    numbers: dict[str, float | None] = {
        f"{protocol}/{name}": result.number(protocol, name) for protocol in PROTOCOLS for name in (*NUMBERS, "seen", "unseen")
    }
    numbers |= {f"calibration/{name}": value for name, value in result.numbers["calibration"].items()}
    for end, measure in REJECTION.items():
        values = of(result, "cells", measure)[:, 0]
        numbers |= {f"rejection/{kind}_{end}": value for kind, value in zip(result.evaluation.kinds, values, strict=True)}
    return {name: present([value])[0] for name, value in numbers.items() if present([value])}
