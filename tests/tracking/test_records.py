"""The runs that MLflow shows follow from the table of results, the list of figures and the records of a sweep."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.evaluation.rows import row, table
from pipeline.sweeps.record import Record
from pipeline.tracking.records import Source, of_sweep
from pipeline.tracking.runs import RunRecord

TESTS = {"june": 20.0, "may": 10.0}
OWNERS = {"curves.svg": ("", ""), "sci.svg": ("sci", ""), "m2dp.svg": ("m2dp", ""), "sci-may.svg": ("sci", "may")}


@pytest.fixture
def record(tmp_path: Path) -> RunRecord:
    """Of a method with numbers on two days, turned queries, a variant, ageing and viewpoints."""
    rows: list[dict[str, Any]] = []
    for sequence, days in TESTS.items():
        at = {"sequence": sequence, "days": days}
        rows += [at | row("auc_top1", "cells", days / 100), at | row("turned_share", "cells", np.nan)]
        rows += [at | row("auroc", "cells", 0.75) | {"kind": "cost"}, at | row("ece", "cells", 0.125)]
        rows += [at | row("auc_top1", "cells", 0.01) | {"change": "turned"}]
        rows += [at | row("auc_top1", "cells", 0.02) | {"variant": "4way"}, at | row("auc_top1", "cells", 0.03) | {"seed": 1}]
    rows += [row("auc_top1_per_100_days", "cells", -0.5, -0.75, -0.25), row("auc_top1_retrain_after_days", "cells", np.inf)]
    rows += [{"sequence": "may", "days": 10.0, "change": "viewpoint", "level": 22.5} | row("accuracy", "", 1.0)]
    figures = [{"file": file, "model": model, "sequence": sequence} for file, (model, sequence) in OWNERS.items()]
    (tmp_path / "figures.json").write_text(json.dumps(figures))
    for file in OWNERS:
        (tmp_path / file).touch()
    found = table(rows, study="campus", grid="10m", method="sci", simulated=True)
    source = Source("campus", "10m", {"train": "april", "tests": [*TESTS]}, True, found, tmp_path)
    return source.record("sci", {"curves/loss": np.array([2.0, 1.0]), "k": np.array(3)}, {"n_way": "2"}, {"cost/s": [(0, 9.0)]})


def test_a_run_holds_its_metrics_over_the_days_and_nothing_of_other_models(record: RunRecord) -> None:
    assert record.name == "sci 10m"
    assert record.params == {"dataset": "campus", "grid": "10m", "train": "april", "n_way": "2"}
    assert record.tags["data"] == "simulated"
    assert record.series == {
        "cells/auc_top1": [(10, 0.1), (20, 0.2)],
        "rejection/cost_auroc": [(10, 0.75), (20, 0.75)],
        "calibration/ece": [(10, 0.125), (20, 0.125)],
        "train/loss": [(1, 2.0), (2, 1.0)],
        "ageing/cells_auc_top1_per_100_days": [(20, -0.5)],
        "ageing/cells_auc_top1_per_100_days_low": [(20, -0.75)],
        "ageing/cells_auc_top1_per_100_days_high": [(20, -0.25)],
        "viewpoints/accuracy may": [(22, 1.0)],
        "cost/s": [(0, 9.0)],
    }


def test_each_day_is_a_child_with_its_own_numbers_and_figures(record: RunRecord) -> None:
    june, may = record.children
    assert june.name == june.params["test"] == june.tags["sequence"] == "june"
    assert june.series["cells/auc_top1"] == [(20, 0.2)]
    figures = [[path.name for path in run.figures] for run in (record, june, may)]
    assert figures == [["curves.svg", "sci.svg"], [], ["sci-may.svg"]]


def test_a_sweep_is_a_run_whose_steps_are_its_jobs() -> None:
    given = {"dataset": "campus", "simulated": False, "method": "sci", "database": "mlflow.db"}
    found = [row("auc_top1", "cells", 0.5), row("recall_at_1", "cells", np.nan), row("recall_at_1", "distance", 0.25)]
    found += [row("queries", "cells", 9), row("ece", "cells", 0.125), row("auroc", "cells", 0.75) | {"kind": "cost"}]
    rows = [{"sequence": "may", "days": 7} | one for one in found]
    done = Record(0, {"grid.cell_m": "5", "method": "sci"}, **given, rows=[*rows, row("held_out_auc", "cells", 0.625)])
    failed = Record(1, {"grid.cell_m": "7", "method": "sci"}, **given, error="7 is odd")
    run = of_sweep([done, failed], {"method": "sci"}, [])
    assert run.name == "sweep cell_m=5,7"
    assert run.params == {"grid.cell_m": "5,7"}
    assert run.series == {
        "sweep/cells_auc_top1": [(0, 0.5)],
        "sweep/distance_recall_at_1": [(0, 0.25)],
        "sweep/held_out_auc": [(0, 0.625)],
    }
    assert [child.name for child in run.children] == ["cell_m=5", "cell_m=7"]
    assert run.children[0].series == {
        "cells/auc_top1": [(7, 0.5)],
        "distance/recall_at_1": [(7, 0.25)],
        "calibration/ece": [(7, 0.125)],
    }
    assert (run.children[1].series, run.children[1].tags["error"]) == ({}, "7 is odd")
