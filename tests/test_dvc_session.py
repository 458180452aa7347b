"""DVC as its users know it: a fresh clone, a killed run, a commit, a changed value, comparisons,
experiments and a further day."""

import csv
import io
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.clone import BIN, Clone, stages_run

ROW = "artifacts/metrics/campus/10m/scan_context/2012-06-15.json"
WITHIN = "conf/tolerance/15m.yaml:distance.correct_m"
METRICS = ("answered", "auc_top1", "recall_at_1", "right_of_answered")
LOCKS = (
    "absent",
    "evaluate",
    "labels",
    "localize",
    "logs",
    "results",
    "scans",
    "submaps",
    "train",
    "views",
)


STUDY = (
    *("yearloc", "use", "campus", "world=tiny", "methods=sci,scan_context"),
    *("variants=", "perturbed=", "latency=no"),
)
KILLED = ("artifacts/logs/campus/.2012-06-15.*.scratch", ".checkpoints/*.safetensors")
"""A run is killed when one of these files appears: once in the simulation, once in training."""


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A repository of the project, one small study in use, committed, and built although its runs
    were killed."""
    clone = Clone(tmp_path_factory.mktemp("session"), git=True)
    clone.draw_small()
    clone.run(*STUDY, "tests=2012-06-15")
    commit(clone, "the study")
    for file in KILLED:
        kill_at(clone, file)
        clone.run("yearloc", "repair")
    clone.run("dvc", "repro")
    return clone


def kill_at(clone: Clone, file: str) -> None:
    """Run `dvc repro`, and kill it with all that it started once a file of this name is there."""
    running = subprocess.Popen(
        [str(BIN / "dvc"), "repro"],
        cwd=clone.folder,
        env=clone.env,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 300
    while not list(clone.folder.glob(file)):
        assert running.poll() is None, f"the chain ended before {file} appeared"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()


def commit(clone: Clone, subject: str) -> None:
    clone.git("add", "--all")
    clone.git("commit", "--quiet", "--message", subject)


def shown(clone: Clone, *command: str) -> dict[str, dict[str, dict[str, float]]]:
    """What `dvc metrics diff` or `dvc params diff` prints: file to name to its old and new
    value."""
    found: dict[str, dict[str, dict[str, float]]] = json.loads(clone.run("dvc", *command, "--json"))
    return found


def test_killed_runs_end_bit_for_bit_as_undisturbed_ones(clone: Clone, built: Clone) -> None:
    """Only queries and reports differ: the other study has perturbed queries too."""
    kinds = ("logs", "scans", "submaps", "views", "labels", "train")
    digests = {
        path: digest
        for path, digest in clone.digests().items()
        if path.split("/")[1] in kinds and not path.endswith(".json")
    }
    assert {path.split("/")[1] for path in digests} == {*kinds}
    assert digests.items() <= built.undisturbed.items()
    assert not list(clone.folder.rglob("*.scratch"))


def test_a_run_leaves_plain_lock_files_for_git_and_nothing_else(clone: Clone) -> None:
    untracked = [line.removeprefix("?? ") for line in clone.git("status", "--short").splitlines()]
    assert sorted(untracked) == [*(f"dag/{stage}/dvc.lock" for stage in LOCKS), "dvc.lock"]
    assert clone.run("dvc", "status") == "Data and pipelines are up to date.\n"
    assert "dag/train/dvc.yaml:train@campus-10m-scan_context" in clone.run("dvc", "dag", "--dot")
    assert clone.repro() == []


def test_experiments_run_here_and_in_the_queue_and_show_what_changed(clone: Clone) -> None:
    commit(clone, "what was built")
    run = ("dvc", "exp", "run")
    here = clone.run(*run, "--name", "here", "--set-param", f"{WITHIN}=4.0")
    assert "Ran experiment(s): here" in here
    ran = {stage.partition("@")[0] for stage in stages_run(here)}
    assert ran == {"evaluate", "results", "report", "publish"}
    metrics = shown(clone, "metrics", "diff")[ROW]
    assert metrics["recall_at_1"]["new"] < metrics["recall_at_1"]["old"]
    assert shown(clone, "params", "diff")["conf/tolerance/15m.yaml"]["distance.correct_m"] == {
        "old": 15.0,
        "new": 4.0,
        "diff": -11.0,
    }
    page = Path(clone.run("dvc", "plots", "diff").strip().removeprefix("file://"))
    assert "workspace" in page.read_text(encoding="utf-8")
    clone.git("checkout", "--quiet", ".")
    clone.run("dvc", "checkout")
    clone.run(*run, "--queue", "--name", "queued", "--set-param", f"{WITHIN}=3.0")
    clone.run(*run, "--run-all")
    rows = {
        row["Experiment"] or row["rev"]: row
        for row in csv_rows(clone.run("dvc", "exp", "show", "--csv"))
    }
    assert (
        float(rows["queued"][f"{ROW}:recall_at_1"])
        <= float(rows["here"][f"{ROW}:recall_at_1"])
        < float(rows["main"][f"{ROW}:recall_at_1"])
    )
    assert {name: rows[name]["distance.correct_m"] for name in ("queued", "here")} == {
        "queued": "3.0",
        "here": "4.0",
    }


def test_a_further_day_trains_nothing_drives_only_itself_and_is_a_row_of_few_columns(
    clone: Clone,
) -> None:
    clone.git("checkout", "--quiet", ".")
    clone.run("dvc", "checkout")
    clone.run(*STUDY, "tests=2012-06-15,2012-02-04")
    ran = set(clone.repro())
    drives = {f"{stage}@campus-2012-02-04" for stage in ("logs", "scans")}
    assert {stage for stage in ran if stage.startswith(("logs", "scans"))} == drives
    asked = {"submaps", "views", "labels", "localize", "evaluate"}
    shown = {"results", "report", "publish"}
    assert {stage.partition("@")[0] for stage in ran - drives} == asked | shown
    heads, _, *rows = clone.run("dvc", "metrics", "show", "--md").strip().splitlines()
    assert {*METRICS[:3], "Path"} <= set(heads.split()) <= {"Path", *METRICS, "|"}
    of_days = {ROW, ROW.replace("06-15", "02-04")}
    of_sci = {row.replace("scan_context", "sci") for row in of_days}
    assert {row.split()[1] for row in rows} == of_days | of_sci


def csv_rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))
