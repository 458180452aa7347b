"""A sweep in MLflow: a parent with the means of its jobs, and a job with its numbers over the days."""

from pathlib import Path
from typing import Any

from pipeline.reports.sweep import Job, Sweep
from pipeline.reports.trials import record


def numbers(days: int, auc: float | None) -> dict[str, Any]:
    found = {"auc_top1": auc, "recall_at_1": 0.5, "auroc": None}
    return {"days": days, "queries": 9, "cells": found, "distance": found, "calibration": {"ece": 0.1, "ece_raw": None}}


JOBS = [
    Job(0, {"grid.cell_m": "5", "view.rings": "20"}, {"a": numbers(20, 0.8), "b": numbers(62, 0.6)}, 0.9),
    Job(1, {"grid.cell_m": "10", "view.rings": "20"}, None, None, "it broke"),
    Job(2, {"grid.cell_m": "20", "view.rings": "20"}, {"a": numbers(20, None), "b": numbers(62, 0.4)}, None),
]
RUN = record(Sweep(JOBS, "campus", True), "sci", [])


def test_the_parent_is_named_by_what_was_swept_and_charts_means_over_the_jobs() -> None:
    assert RUN.name == "sweep cell_m=5,10,20 rings=20"
    assert RUN.params == {"grid.cell_m": "5,10,20", "view.rings": "20"}
    # .8 and .6 have the mean .7; the second job failed; of the third, one sequence has no AUC.
    assert RUN.series["sweep/cells_auc_top1"] == [(0, 0.7), (2, 0.4)]
    assert RUN.series["sweep/held_out_auc"] == [(0, 0.9)]
    assert RUN.tags["data"] == "simulated"


def test_a_job_has_its_numbers_over_the_days_and_a_failed_one_its_error() -> None:
    first, failed, last = RUN.children
    assert [child.name for child in RUN.children] == ["cell_m=5 rings=20", "cell_m=10 rings=20", "cell_m=20 rings=20"]
    assert first.series["cells/auc_top1"] == [(20, 0.8), (62, 0.6)]
    assert first.series["calibration/ece"] == [(20, 0.1), (62, 0.1)]
    assert "cells/auroc" not in first.series
    assert last.series["cells/auc_top1"] == [(62, 0.4)]
    assert failed.series == {}
    assert failed.tags["error"] == "it broke"
    assert "error" not in first.tags


def test_the_figures_go_to_the_parent(tmp_path: Path) -> None:
    (tmp_path / "sweep.svg").write_text("<svg/>")
    run = record(Sweep(JOBS, "campus", False), "sci", [tmp_path / "sweep.svg"])
    assert [path.name for path in run.figures] == ["sweep.svg"]
    assert run.tags["data"] == "recorded"
    assert all(not child.figures for child in run.children)
