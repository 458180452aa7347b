"""A study gathered from artifacts, drawn, and shown as MLflow runs."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.evaluation.judgement import summary
from pipeline.reports import gallery
from pipeline.reports.study import Study, folders
from tests.reports.made import TRAIN_PLACES, TRAIN_XY_M, XY_M, evaluation

TRAIN, TESTS = "2012-01-15", {"2012-02-04": 20, "2012-03-17": 62}
LOOKS = {"sci": "scan_context", "m2dp": "m2dp"}
FILES = {
    *("precision_recall_cells.svg", "precision_recall_distance.svg", "year.svg", "recall_at.svg", "outcomes.svg"),
    *(f"{kind}_{method}.svg" for kind in ("novelty", "rejection", "matches") for method in LOOKS),
    *("reliability_sci.svg", "history_sci.svg"),
    *(f"outcomes_{method}_{sequence}.svg" for method in LOOKS for sequence in TESTS),
    *("report.md", "results.txt", "year.csv", "precision_recall.csv"),
}


def poses(xy_m: np.ndarray) -> np.ndarray:
    world_T_anchor = np.tile(np.eye(4), (len(xy_m), 1, 1))
    world_T_anchor[:, :2, 3] = xy_m
    return world_T_anchor


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the stages before the report leave, at its smallest."""
    root = tmp_path_factory.mktemp("artifacts")
    find = folders(root, "campus", "10m", LOOKS)
    model = {f"curves/{name}": np.array([2.0, 1.0]) for name in ("loss", "accuracy", "held_out_loss", "held_out_accuracy")}
    find("train", method="sci").parent.mkdir(parents=True)
    store.write_model(find("train", method="sci"), model | {"best_epoch": np.array(1)}, {"epochs": 2})
    store.write_model(find("train", method="m2dp"), {"descriptors": np.zeros((50, 192), np.float32)}, {"view": "m2dp"})
    for sequence, xy_m in ((TRAIN, TRAIN_XY_M), *((name, XY_M) for name in TESTS)):
        n = len(xy_m)
        images = np.random.default_rng(n).uniform(0, 9, (n, 40, 120)).astype(np.float32)
        with store.write(find("views", sequence, "sci"), schemas.VIEWS) as draft:
            for name, column in (("images", images), ("stamps_ns", np.arange(n)), ("world_T_anchor", poses(xy_m))):
                draft.put(name, column)
        with store.write(find("views", sequence, "m2dp"), schemas.SIGNATURES) as draft:
            for name, column in (("images", images[:, 0]), ("stamps_ns", np.arange(n)), ("world_T_anchor", poses(xy_m))):
                draft.put(name, column)
    rows = np.arange(50)
    with store.write(find("submaps", TRAIN), schemas.SUBMAPS, layout="world_T_scan", left_out={}) as draft:
        for name, column in (("first", rows), ("scans", rows), ("stamps_ns", rows), ("world_T_anchor", poses(TRAIN_XY_M))):
            draft.put(name, column)
        draft.put("ground_m", np.zeros(50))
        draft.put("used", np.ones(50, bool))
    with store.write(find("labels", TRAIN), schemas.LABELS, days=0, cell_m=10.0, x_m=[0, 100], y_m=[0, 10]) as draft:
        draft.put("cells", np.arange(10))
        for name, column in (("places", TRAIN_PLACES), ("oracle", TRAIN_PLACES)):
            draft.put(name, column)
        for name in ("nearest_m", "nearest_turn_deg"):
            draft.put(name, np.zeros(50))
    attrs = {"wanted_precision": 0.9, "train": TRAIN, "bootstrap": {"resamples": 40}, "distance": {"correct_m": 12.0}}
    for method in LOOKS:
        numbers = {}
        for sequence, days in TESTS.items():
            one = evaluation(days, method=method)
            with store.write(
                find("evaluate", sequence, method), schemas.EVALUATIONS, **one.attrs(), **attrs, sequence=sequence
            ) as draft:
                for name, column in one.columns().items():
                    draft.put(name, column)
            numbers[sequence] = summary(one)
        find("metrics", method=method).write_text(json.dumps(numbers))
    return root


@pytest.fixture(scope="module")
def study(artifacts: Path) -> Study:
    find = folders(artifacts, "campus", "10m", LOOKS)
    return Study.gather(find, "campus", "10m", TRAIN, list(TESTS), list(LOOKS), simulated=True)


@pytest.fixture(scope="module")
def drawn(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "10m"
    study.write(folder)
    return folder


def test_dvc_artifacts_lie_where_the_stages_leave_them() -> None:
    find = folders(Path("a"), "campus", "5m", {"sci": "scan_context"})
    assert str(find("train", method="sci")) == "a/train/campus/5m/sci.safetensors"
    assert str(find("labels", "2012-01-15")) == "a/labels/campus/5m/2012-01-15.zarr"
    assert str(find("submaps", "2012-01-15")) == "a/submaps/campus/2012-01-15.zarr"
    assert str(find("views", "2012-01-15", "sci")) == "a/views/campus/scan_context/2012-01-15.zarr"
    assert str(find("evaluate", "2012-02-04", "sci")) == "a/evaluate/campus/5m/sci/2012-02-04.zarr"
    assert str(find("metrics", method="sci")) == "a/evaluate/campus/5m/sci.json"


def test_the_report_tells_the_distances_that_were_judged_by(study: Study, drawn: Path) -> None:
    assert study.distance.correct_m == 12
    assert "12 m" in (drawn / "results.txt").read_text()


def test_a_study_draws_every_figure_and_links_it_in_the_report(drawn: Path) -> None:
    assert {path.name for path in drawn.iterdir()} == FILES
    report = (drawn / "report.md").read_text()
    assert all(f"]({name})" in report for name in FILES if name.endswith(".svg"))
    assert all("simulated, not recorded" in path.read_text() for path in drawn.glob("*.svg"))


def test_what_no_scan_context_was_looked_at_for_is_shown_by_those_of_another_method(study: Study, drawn: Path) -> None:
    def heading(study: Study, method: str) -> list[str]:
        plate = next(plate for plate in gallery.plates(study) if plate.illustration.path == f"matches_{method}.svg")
        fig = plate.draw()
        return [] if fig is None else [text.get_text() for text in fig.texts]

    assert "sci: queries and the training images they were matched with" in heading(study, "sci")
    assert "m2dp: queries and the training images they were matched with, as Scan Contexts" in heading(study, "m2dp")
    alone = replace(study, results=study.results[2:], models={"m2dp": study.models["m2dp"]})
    assert heading(alone, "m2dp") == []
    listed = [path.name for path in gallery.files(alone, drawn.parent / "empty", "m2dp")]
    assert "novelty_m2dp.svg" in listed
    assert "matches_m2dp.svg" not in listed


def test_a_study_holds_every_other_method_against_the_first(study: Study) -> None:
    assert {(one.result.method, one.reference) for one in study.tested} == {("m2dp", "sci")}
    assert study.tested is study.tested  # tested once, told thrice


def test_a_study_is_written_the_same_each_time(study: Study, drawn: Path, tmp_path: Path) -> None:
    study.write(tmp_path / "again")
    assert all((tmp_path / "again" / name).read_bytes() == (drawn / name).read_bytes() for name in FILES)


def test_a_result_knows_its_numbers_its_interval_and_the_wanted_precision(study: Study) -> None:
    one = study.results[0]
    assert one.label == "2012-02-04, +20 d"
    assert one.number("cells", "recall_at_1") == pytest.approx(0.6)
    low, high = one.interval("cells", "recall_at_1") or (1.0, 0.0)
    assert low <= 0.6 <= high
    assert one.interval("cells", "seen") is None
    assert one.wanted_precision == 0.9


def test_runs_hold_the_year_the_training_and_a_child_a_sequence(study: Study, drawn: Path) -> None:
    run, other = study.runs(drawn, {"sci": "#0072B2", "m2dp": "#009E73"})
    assert run.name == "sci 10m"
    assert run.params["epochs"] == "2"
    assert run.tags["data"] == "simulated"
    assert run.series["cells/recall_at_1"] == [(20, pytest.approx(0.6)), (62, pytest.approx(0.6))]
    assert run.series["distance/recall_at_1"] == [(20, pytest.approx(0.8)), (62, pytest.approx(0.8))]
    assert run.series["rejection/energy_precision"] == [(20, pytest.approx(0.6)), (62, pytest.approx(0.6))]
    assert run.series["train/loss"] == [(1, 2.0), (2, 1.0)]
    assert {"calibration/ece", "calibration/ece_raw", "cells/auc_top1", "rejection/entropy_recall"} <= run.series.keys()
    own = {name for name in FILES if name.endswith(".svg") and "outcomes_" not in name and "m2dp" not in name}
    assert {path.name for path in run.figures} == own
    assert [child.name for child in run.children] == ["2012-02-04", "2012-03-17"]
    assert [path.name for path in run.children[0].figures] == ["outcomes_sci_2012-02-04.svg"]
    assert run.children[1].series["cells/auroc"] == [(62, pytest.approx(0.9))]
    assert (other.name, other.tags["mlflow.runColor"]) == ("m2dp 10m", "#009E73")
    assert not {name for name in other.series if name.startswith(("train/", "calibration/")) or "heading_error" in name}
    assert {"rejection/distance_auroc", "cells/oracle_auc_exact_top1"} <= other.series.keys()
    assert run.series["ageing/cells_recall_at_1_per_100_days"] == [(62, pytest.approx(0.0))]
    assert not {name for name in run.series if name.startswith("ageing/novelty")}  # neither model keeps what it held out


def test_a_missing_artifact_is_named(artifacts: Path, tmp_path: Path) -> None:
    find = folders(artifacts, "campus", "10m", LOOKS)
    with pytest.raises(ArtifactError, match=r"10m/sci\.json: no numbers of 2013-04-05; `dvc repro` makes them"):
        Study.gather(find, "campus", "10m", TRAIN, ["2013-04-05"], ["sci"], simulated=True)
    shutil.copytree(artifacts, tmp_path / "a")
    find = folders(tmp_path / "a", "campus", "10m", LOOKS)
    shutil.rmtree(find("evaluate", "2012-03-17", "m2dp"))
    with pytest.raises(ArtifactError, match=r"m2dp/2012-03-17\.zarr: no such artifact"):
        Study.gather(find, "campus", "10m", TRAIN, list(TESTS), list(LOOKS), simulated=True)
