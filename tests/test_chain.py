"""The whole chain at its smallest: what runs, what does not run again, and what a kill costs."""

import json
import os
import signal
import sqlite3
import subprocess
import time
from contextlib import closing

import pytest
import yaml

from pipeline.studies.expansion import LISTS
from pipeline.studies.names import text
from tests.clone import BIN, Clone


def test_every_stage_runs_once_and_leaves_its_artifact(built):
    kinds = {stage.partition("@")[0] for stage in built.ran}
    assert kinds == {
        "logs",
        "scans",
        "submaps",
        "views",
        "birdviews",
        "labels",
        "train",
        "localize",
        "evaluate",
        "events",
        "report",
        "viewpoints",
        "robustness",
        "cells",
        "latency",
        "publish",
    }
    lists = yaml.safe_load((built.folder / "conf/benchmark.yaml").read_text())["benchmark"]
    twice = ("drives", "rankings", "reports")  # logs and scans; localize and evaluate; report and latency
    wanted = sum(len(lists[name]) * (1 + (name in twice)) for name in LISTS)
    assert len(built.ran) == len(set(built.ran)) == wanted
    assert not list(built.folder.rglob("*.scratch"))
    assert not list((built.folder / ".checkpoints").glob("*"))


def test_the_reports_say_that_campus_and_town_are_simulated(built):
    for told in ("report/campus/10m/report.md", "report/town/10m/report.md", "viewpoints/suburb/10m/viewpoints.md"):
        folder = (built.folder / "artifacts" / told).parent
        assert "simulated" in (folder / told.rpartition("/")[2]).read_text().lower()
        assert all("simulated, not recorded" in path.read_text() for path in folder.glob("*.svg"))
    assert built.run("yearloc", "results").count("simulated") >= 2


def test_robustness_is_told_of_each_alteration_and_stress_and_every_model(built):
    folder = built.folder / "artifacts/robustness/town/10m"
    assert sorted(path.stem for path in folder.glob("*.json")) == ["as_driven", "turned"]
    turned = json.loads((folder / "turned.json").read_text())
    assert set(turned) == {"sci", "scan_context", "scan_context-engaged"}
    ((_, cases),) = turned["scan_context-engaged"].items()
    assert [case["case"]["change"] for case in cases] == ["as driven"] + 5 * ["turned"]
    alone = json.loads((built.folder / "artifacts/evaluate/town/10m/sci.json").read_text())["2014-11-25-09-18-32"]
    as_driven = turned["sci"]["2014-11-25-09-18-32"][0]
    assert as_driven["cells"]["auc_top1"] == pytest.approx(alone["cells"]["auc_top1"])  # the same views, drawn again
    assert len(json.loads((folder / "as_driven.json").read_text())["sci"]) == 3  # the sequences of stress
    told = json.loads((built.folder / "artifacts/cells/town/section.json").read_text())
    assert "5m" in str(told["sources"])


def test_the_page_holds_every_section_of_the_studies(built, tmp_path):
    line = built.run("python", "-m", "stages.page", f"out={tmp_path}/page.html")
    assert line.startswith("page: ")
    page = (tmp_path / "page.html").read_text()
    for name in (
        "town-10m-turned",
        "town-10m-as-driven",
        "town-cells",
        "town-10m-ageing",
        "town-10m-events",
        "campus-10m-glance",
    ):
        assert f'id="{name}"' in page


def test_viewpoints_are_told_by_heading_in_files_and_in_mlflow(built):
    numbers = json.loads((built.folder / "artifacts/viewpoints/suburb/10m.json").read_text())
    ((asked, (only,)),) = numbers.items()
    assert asked == "sad 00"
    assert list(only) == [*(f"{22.5 + 45 * i:g}_deg" for i in range(8)), "mean"]
    with closing(sqlite3.connect(built.folder / "mlflow.db")) as database:
        steps = database.execute("select step from metrics where key = 'viewpoints/accuracy 2012-06-15'").fetchall()
    assert sorted(step for (step,) in steps) == sorted(2 * [22, 67, 112, 157, 202, 247, 292, 337])  # of pfl and sad


def test_a_second_run_runs_nothing(built):
    assert built.repro() == []


@pytest.mark.parametrize(
    ("path", "old", "new", "stages"),
    [
        ("conf/method/sci.yaml", "n_way: 2", "n_way: 4", {"train", "localize"}),
        ("conf/method/sci.yaml", "colormap: jet", "colormap: grey", {"train", "localize"}),
        ("conf/view/scan_context.yaml", "rings: 40", "rings: 20", {"views"}),
        ("conf/view/birdview_campus.yaml", "depth: 7", "depth: 6", {"birdviews"}),
        ("conf/viewpoints.yaml", "correct_m: 10.0", "correct_m: 5.0", {"viewpoints"}),
        ("conf/grid/10m.yaml", "10.0", "12.0", {"labels"}),
        ("conf/submap/single.yaml", "1.0", "2.0", {"submaps"}),
        ("conf/submap/accumulated.yaml", "80.0", "60.0", {"submaps"}),
        ("conf/dataset/town.yaml", "lift_m: 0.0", "lift_m: 1.0", {"scans"}),
        ("conf/world/campus_tiny.yaml", "seed: 0", "seed: 1", {"logs"}),
        ("conf/world/town_tiny.yaml", "seed: 1", "seed: 2", {"logs", "events"}),
        ("conf/alteration/turned.yaml", "repeats: 5", "repeats: 4", {"robustness"}),
        ("conf/evaluate.yaml", "seen_m: 5.0", "seen_m: 6.0", {"evaluate", "robustness"}),
        ("conf/compute/threads.yaml", "workers: 0", "workers: 1", set()),
        ("conf/tracking/local.yaml", "5000", "5001", set()),
    ],
)
def test_an_edit_touches_exactly_its_stages(built, path, old, new, stages):
    before = built.edit(path, old, new)
    try:
        assert {stage.partition("@")[0] for stage in built.outdated()} == stages
    finally:
        (built.folder / path).write_text(before)


def test_a_new_test_sequence_trains_nothing_and_drives_only_itself(built, tmp_path):
    twin = built.twin(tmp_path)
    path = tmp_path / "conf/benchmark.yaml"
    studies = yaml.safe_load(path.read_text())["benchmark"]["studies"]
    new = "2012-02-04"
    studies["campus"]["tests"].append(new)
    del studies["campus"]["methods"][1:]
    path.write_text(text(studies))
    ran = twin.repro()
    own = {f"{stage}@campus-{new}" for stage in ("logs", "scans")}
    assert {stage for stage in ran if stage.partition("@")[0] in ("logs", "scans")} == own
    asked = {"submaps", "views", "labels", "localize", "evaluate", "report", "robustness", "latency", "publish"}
    assert {stage.partition("@")[0] for stage in set(ran) - own} == asked
    assert not [stage for stage in ran if "town" in stage]


def test_a_kill_at_any_moment_is_repaired_by_the_next_run(built, tmp_path):
    """The group is killed once in the simulation and once in training; the artifacts end bit for bit as undisturbed."""
    clone = Clone(tmp_path)
    clone.run("yearloc", "use", "campus", "world=tiny", "tests=2012-06-15", "methods=sci", "altered=")
    for sign in ("artifacts/logs/campus/.2012-06-15.*.scratch", ".checkpoints/*.safetensors"):
        running = subprocess.Popen(
            [str(BIN / "dvc"), "repro"],
            cwd=tmp_path,
            env=clone.env,
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + 120
        while not list(tmp_path.glob(sign)):
            assert running.poll() is None, f"the chain ended before {sign} appeared"
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
        clone.run("yearloc", "repair")
    clone.repro()
    of_all = ("/report/", "/latency/", ".json")  # what tells of all tests, and of the clock
    found = {path: digest for path, digest in clone.digests().items() if not any(word in path for word in of_all)}
    assert len({path.split("/")[1] for path in found}) == 8
    assert found.items() <= built.undisturbed.items()
    assert not list(tmp_path.rglob("*.scratch"))
