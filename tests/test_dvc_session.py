"""DVC as its users know it: a fresh clone, a commit, a changed value, comparisons and
experiments."""

import csv
import io
import json
from pathlib import Path

import pytest

from tests.clone import Clone

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


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A repository of the project, one small study in use, built and committed."""
    clone = Clone(tmp_path_factory.mktemp("session"), git=True)
    clone.draw_small()
    small = ("methods=scan_context", "tests=2012-06-15", "variants=", "altered=", "latency=no")
    clone.run("yearloc", "use", "campus", "world=tiny", *small)
    commit(clone, "the study")
    clone.run("dvc", "repro")
    return clone


def commit(clone: Clone, subject: str) -> None:
    clone.git("add", "--all")
    clone.git("commit", "--quiet", "--message", subject)


def shown(clone: Clone, *command: str) -> dict[str, dict[str, dict[str, float]]]:
    """What `dvc metrics diff` or `dvc params diff` prints: file to name to its old and new
    value."""
    found: dict[str, dict[str, dict[str, float]]] = json.loads(clone.run("dvc", *command, "--json"))
    return found


def test_a_run_leaves_plain_lock_files_for_git_and_nothing_else(clone: Clone) -> None:
    untracked = [line.removeprefix("?? ") for line in clone.git("status", "--short").splitlines()]
    assert sorted(untracked) == [*(f"dag/{stage}/dvc.lock" for stage in LOCKS), "dvc.lock"]
    assert clone.run("dvc", "status") == "Data and pipelines are up to date.\n"
    assert "dag/train/dvc.yaml:train@campus-10m-scan_context" in clone.run("dvc", "dag", "--dot")
    assert clone.repro() == []


def test_metrics_are_a_row_a_sequence_and_method_with_few_columns(clone: Clone) -> None:
    heads, _, row = clone.run("dvc", "metrics", "show", "--md").strip().splitlines()
    assert (
        {"Path", "answered", "auc_top1", "recall_at_1"}
        <= set(heads.split())
        <= {"Path", *METRICS, "|"}
    )
    assert "artifacts/metrics/campus/10m/scan_context/2012-06-15.json" in row


def test_a_changed_value_shows_in_the_differences_to_the_last_commit(clone: Clone) -> None:
    commit(clone, "what was built")
    before = clone.edit("conf/tolerance/15m.yaml", "correct_m: 15.0", "correct_m: 5.0")
    assert {stage.partition("@")[0] for stage in clone.repro()} == {
        "evaluate",
        "results",
        "report",
        "publish",
    }
    (metrics,) = shown(clone, "metrics", "diff").values()
    assert metrics["recall_at_1"]["new"] < metrics["recall_at_1"]["old"]
    assert shown(clone, "params", "diff")["conf/tolerance/15m.yaml"]["distance.correct_m"] == {
        "old": 15.0,
        "new": 5.0,
        "diff": -10.0,
    }
    page = Path(clone.run("dvc", "plots", "diff").strip().removeprefix("file://"))
    assert "workspace" in page.read_text(encoding="utf-8")
    (clone.folder / "conf/tolerance/15m.yaml").write_text(before)
    clone.run("dvc", "checkout")
    clone.git("checkout", "--quiet", ".")


def test_experiments_run_here_and_in_the_queue_and_are_shown_with_numbers(clone: Clone) -> None:
    if clone.git("status", "--short"):
        commit(clone, "what was built")
    here = clone.run("dvc", "exp", "run", "--name", "here", "--set-param", f"{WITHIN}=4.0")
    assert "Ran experiment(s): here" in here
    clone.git("checkout", "--quiet", ".")
    clone.run("dvc", "checkout")
    clone.run("dvc", "exp", "run", "--queue", "--name", "queued", "--set-param", f"{WITHIN}=3.0")
    clone.run("dvc", "exp", "run", "--run-all")
    rows = {
        row["Experiment"] or row["rev"]: row
        for row in csv_rows(clone.run("dvc", "exp", "show", "--csv"))
    }
    assert (
        float(rows["queued"]["recall_at_1"])
        <= float(rows["here"]["recall_at_1"])
        < float(rows["main"]["recall_at_1"])
    )
    assert {name: rows[name]["distance.correct_m"] for name in ("queued", "here")} == {
        "queued": "3.0",
        "here": "4.0",
    }


def csv_rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))
