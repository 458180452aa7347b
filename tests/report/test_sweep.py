"""A sweep's table, what validation blocks choose, and its report."""

from pathlib import Path

import numpy as np
from syrupy.assertion import SnapshotAssertion

from pipeline.evaluation.rows import row
from pipeline.report import sweep
from pipeline.sweeps.record import Record


def record(
    number: int,
    cell: str,
    n_way: str,
    auc: float,
    validation: float | None,
    error: str | None = None,
) -> Record:
    reported = {"grid.cell_m": cell, "method.n_way": n_way, "budget": "demo", "hydra.verbose": "1"}
    rows = [] if validation is None else [row("validation_auc", "cells", validation)]
    for off in () if error else (0.0, 0.2):
        cells = {
            "auc_top1": auc - off,
            "recall_at_1": 0.5 + off,
            "auroc": np.nan,
            "median_error_m": 3.0,
            "oracle": 0.9,
        }
        for protocol, numbers in {
            "cells": cells,
            "distance": cells | {"recall_at_1": 0.6 + off},
        }.items():
            rows += [row(name, protocol, value) for name, value in numbers.items()]
    return Record(number, reported, "campus", True, "sci", error, rows)


BROKEN = record(3, "10", "7", 0.0, None, "n_way=7: must divide 120")
JOBS = [
    BROKEN,
    record(0, "5", "1", 0.7, 0.61),
    record(1, "5", "2", 0.8, 0.72),
    record(2, "10", "1", 0.9, 0.8),
]


def test_a_sweep_has_a_row_a_job_and_validation_blocks_choose_within_each_grid(
    tmp_path: Path, snapshot: SnapshotAssertion
) -> None:
    text = sweep.write(tmp_path, JOBS, {"hydra.verbose": "1"})
    rows = {line[0]: line.split()[1:] for line in text.splitlines() if line[:1].isdigit()}
    # The deviation of .7 and .5 with one degree of freedom is .2/√2 = .141; nothing has an AUROC.
    mean = [
        "0.600",
        "±",
        ".141",
        "0.600",
        "±",
        ".141",
        "0.700",
        "±",
        ".141",
        "–",
        "3.0",
        "±",
        "0.0",
    ]
    assert rows["0"] == ["5", "1", *mean, "0.610"]
    assert rows["3"] == ["10", "7", *["–"] * 5, "failed"]
    assert text == snapshot(name="sweep.txt")
    assert (tmp_path / "sweep.md").read_text() == snapshot(name="sweep.md")
    assert (tmp_path / "sweep.txt").read_text() == text


def test_a_sweep_in_which_all_failed_is_reported_and_not_drawn(tmp_path: Path) -> None:
    assert sweep.write(tmp_path, [BROKEN], {}).startswith(
        "simulated campus: 1 job, grid.cell_m=10, method.n_way=7"
    )
    assert not (tmp_path / "sweep.svg").exists()
