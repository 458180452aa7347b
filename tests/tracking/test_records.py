"""The runs that MLflow shows follow from the table of results, the list of figures and the records
of a sweep."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import ArtifactError
from pipeline.evaluation.rows import HEADING, NOVELTY, PERTURBED, VIEWPOINT, row, table
from pipeline.running.dvc_files import DvcLock
from pipeline.studies.models import ModelName
from pipeline.sweeps.record import Record
from pipeline.tracking.page import COLOUR
from pipeline.tracking.records import StudyRuns, of_sweep, used_sequences
from pipeline.tracking.runs import RunRecord
from tests.studies.made import RECORDED
from tests.studies.made import study as made_study

TESTS = {"june": 20.0, "may": 10.0}
OWNERS = {
    "curves.svg": ("", ""),
    "sci.svg": ("sci", ""),
    "m2dp.svg": ("m2dp", ""),
    "sci-may.svg": ("sci", "may"),
}


@pytest.fixture
def record(tmp_path: Path) -> RunRecord:
    """The run of a method with numbers on two days, turned queries, a variant, ageing,
    viewpoints."""
    rows: list[dict[str, Any]] = []
    for sequence, days in TESTS.items():
        at = {"sequence": sequence, "days": days}
        rows += [
            at | row("auc_top1", "cells", days / 100),
            at | row("turned_share", "cells", np.nan),
        ]
        rows += [
            at | row("auroc", "cells", 0.75) | {"ask": NOVELTY, "of": "cost"},
            at | row("ece", "cells", 0.125),
        ]
        rows += [at | row("auc_top1", "cells", 0.01) | {"ask": PERTURBED, "of": "turned"}]
        rows += [
            at | row("auc_top1", "cells", 0.02) | {"variant": "4way"},
            at | row("auc_top1", "cells", 0.03) | {"seed": 1},
        ]
    rows += [
        row("auc_top1_per_100_days", "cells", -0.5, -0.75, -0.25),
        row("auc_top1_retrain_after_days", "cells", np.inf),
        row("awc_ft", "cells", 0.125),
        row("awc_ft", "distance", np.nan),
    ]
    rows += [
        {"sequence": "may", "days": 10.0, "ask": VIEWPOINT, "of": HEADING, "at": 22.5}
        | row("accuracy", "", 1.0)
    ]
    figures = [
        {"file": file, "model": model, "sequence": sequence}
        for file, (model, sequence) in OWNERS.items()
    ]
    (tmp_path / "figures.json").write_text(json.dumps(figures))
    for file in OWNERS:
        (tmp_path / file).touch()
    found = table(rows, study="campus", grid="10m", method="sci", simulated=True)
    study = made_study(train="april", tests=[*TESTS], budget="demo")
    lock = DvcLock(
        {"submaps@campus": {"outs": [{"path": "artifacts/submaps/campus", "md5": "0123.dir"}]}}
    )
    study_runs = StudyRuns(study, "10m", found, tmp_path, lock)
    arrays = {"curves/loss": np.array([2.0, 1.0]), "k": np.array(3), "place_xy_m": np.zeros((7, 2))}
    recipe = {"_target_": "pipeline.methods.sci.Sci", "budget": "0.1"}
    return study_runs.method_run(ModelName("sci"), arrays, recipe, {"cost/s": [(0, 9.0)]})


def test_a_run_holds_its_metrics_over_the_days_and_nothing_of_other_models(
    record: RunRecord,
) -> None:
    assert record.name == "sci"
    assert (
        record.params.items()
        >= {"dataset": "campus", "grid": "10m", "train": "april", "budget": "0.1"}.items()
    )
    assert record.tags["data"] == "simulated"
    assert record.series == {
        "cells/auc_top1": [(10, 0.1), (20, 0.2)],
        "mean/cells_auc_top1": [(0, pytest.approx(0.15))],
        "rejection/cost_auroc": [(10, 0.75), (20, 0.75)],
        "calibration/ece": [(10, 0.125), (20, 0.125)],
        "train/loss": [(1, 2.0), (2, 1.0)],
        "ageing/cells_auc_top1_per_100_days": [(0, -0.5)],
        "ageing/cells_auc_top1_per_100_days_low": [(0, -0.75)],
        "ageing/cells_auc_top1_per_100_days_high": [(0, -0.25)],
        "ageing/cells_awc_ft": [(0, 0.125)],
        "viewpoints/accuracy may": [(22, 1.0)],
        "cost/s": [(0, 9.0)],
    }


def test_a_run_says_what_it_is_what_it_was_trained_on_and_that_the_data_is_simulated(
    record: RunRecord,
) -> None:
    assert record.about.startswith("SCI localisation")
    for said in (
        "**Simulated data**",
        "Trained on april (7 places)",
        "budget `demo`: 0.1",
        "2 days: june, may",
        "($page)",
    ):
        assert said in record.about
    assert record.registered == "campus-sci-simulated"
    may = record.children[1]
    assert "may, 10 days after the training sequence april" in may.about
    assert "**Simulated data**" in may.about


def test_a_run_names_its_sequences_and_a_day_its_own(record: RunRecord) -> None:
    assert [(one.name, one.context) for one in record.used] == [
        ("campus april", "train"),
        ("campus june", "test"),
        ("campus may", "test"),
    ]
    assert len({one.digest for one in record.used}) == 3
    june, may = record.children
    assert ([*june.used], [*may.used]) == ([record.used[1]], [record.used[2]])


def test_a_digest_changes_with_the_submaps_that_dvc_recorded() -> None:
    study = made_study(train="april", tests=["may"])

    def digest(lock: DvcLock) -> str:
        return used_sequences(study, ["may"], lock)[0].digest

    locks = [
        DvcLock({"s": {"outs": [{"path": "artifacts/submaps/campus", "md5": md5}]}})
        for md5 in ("12", "34")
    ]
    assert len({digest(locks[0]), digest(locks[1]), digest(DvcLock({}))}) == 3
    assert digest(DvcLock({})) == digest(DvcLock({}))


def test_with_several_grids_a_run_names_its_own(tmp_path: Path) -> None:
    study = made_study("nclt", train="april", grids=["5m", "10m"], **RECORDED)
    (tmp_path / "figures.json").write_text("[]")
    rows = table([], study="nclt", grid="5m", method="sci", simulated=False)
    found = StudyRuns(study, "5m", rows, tmp_path).method_run(ModelName("sci"), {}, {}, {})
    assert (found.name, found.registered) == ("sci 5m", "nclt-sci-5m")
    assert "**Recorded data**" in found.about


def test_each_day_is_a_child_with_its_own_numbers_and_figures(record: RunRecord) -> None:
    june, may = record.children
    assert june.name == june.params["test"] == june.tags["sequence"] == "june"
    assert june.series["cells/auc_top1"] == [(20, 0.2)]
    figures = [[path.name for path in run.figures] for run in (record, june, may)]
    assert figures == [["curves.svg", "sci.svg"], [], ["sci-may.svg"]]


def test_a_sweep_is_a_run_whose_steps_are_its_jobs() -> None:
    given = {"dataset": "campus", "simulated": False, "method": "sci"}
    found = [
        row("auc_top1", "cells", 0.5),
        row("recall_at_1", "cells", np.nan),
        row("recall_at_1", "distance", 0.25),
    ]
    found += [
        row("queries", "cells", 9),
        row("ece", "cells", 0.125),
        row("auroc", "cells", 0.75) | {"ask": NOVELTY, "of": "cost"},
    ]
    rows = [{"sequence": "may", "days": 7} | one for one in found]
    done = Record(
        0,
        {"grid.cell_m": "5", "method": "sci"},
        **given,
        rows=[*rows, row("validation_auc", "cells", 0.625)],
    )
    failed = Record(1, {"grid.cell_m": "7", "method": "sci"}, **given, error="7 is odd")
    run = of_sweep([done, failed], {"method": "sci"}, [])
    assert run.name == "sweep cell_m=5,7"
    assert run.params == {"grid.cell_m": "5,7"}
    assert run.series == {
        "sweep/cells_auc_top1": [(0, 0.5)],
        "sweep/distance_recall_at_1": [(0, 0.25)],
        "sweep/validation_auc": [(0, 0.625)],
    }
    assert [child.name for child in run.children] == ["cell_m=5", "cell_m=7"]
    assert run.children[0].series == {
        "cells/auc_top1": [(7, 0.5)],
        "distance/recall_at_1": [(7, 0.25)],
        "calibration/ece": [(7, 0.125)],
    }
    assert (run.children[1].series, run.children[1].tags["error"]) == ({}, "7 is odd")


def test_what_answers_with_poses_has_a_run_of_its_own_and_no_registered_model(
    tmp_path: Path,
) -> None:
    (tmp_path / "figures.json").write_text("[]")
    rows = []
    for variant, share in (("", 0.5), ("pose", 0.75)):
        place = {
            "grid": "10m",
            "method": "sci",
            "variant": variant,
            "sequence": "2012-02-04",
            "days": 20,
        }
        rows.append(place | row("recall_at_1", "distance", share))
    study = made_study("nclt", tests=["2012-02-04"], **RECORDED)
    study_runs = StudyRuns(study, "10m", table(rows, study="nclt", dataset="nclt"), tmp_path)
    plain, posed = (
        study_runs.method_run(ModelName("sci", posed=posed), {}, {}, {}) for posed in (False, True)
    )
    assert (plain.name, posed.name) == ("sci", "sci-pose")
    assert (
        plain.series["mean/distance_recall_at_1"],
        posed.series["mean/distance_recall_at_1"],
    ) == ([(0, 0.5)], [(0, 0.75)])
    assert (plain.registered, posed.registered) == ("nclt-sci", "")
    assert plain.tags[COLOUR] != posed.tags[COLOUR]


def test_a_report_that_was_interrupted_is_named(tmp_path: Path) -> None:
    study_runs = StudyRuns(made_study(), "10m", table([]), tmp_path / "report/campus/10m")
    with pytest.raises(
        ArtifactError, match=r"report/campus/10m: no report yet; `dvc repro` writes it"
    ):
        study_runs.figure_files("sci")
