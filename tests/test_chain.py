"""The whole chain at its smallest: what runs, and what does not run again."""

import io
import json
import os
import re
import shlex
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from distributed import LocalCluster

from pipeline.core import schemas, store
from pipeline.core.schemas import Lifelong
from pipeline.evaluation import results
from pipeline.running.dvc_files import DvcLock, definition
from pipeline.studies.expansion import LISTS
from pipeline.studies.layout import Layout
from tests.clone import ROOT, Clone
from tests.studies.made import study as made_study


def test_every_stage_runs_once_and_leaves_its_artifact(built):
    ran = {stage.partition("@")[0] for stage in built.ran}
    # learning further days is below; both studies have reference poses
    assert ran == set(definition(ROOT)["stages"]) - {"lifelong", "slam", "slam_further", "squares"}
    lists = yaml.safe_load((built.folder / "conf/lists.yaml").read_text())["lists"]
    # logs and scans of a drive
    wanted = sum(len(lists[name]) * (1 + (name == "drives")) for name in LISTS)
    assert len(built.ran) == len(set(built.ran)) == wanted
    assert not list(built.folder.rglob("*.scratch"))
    assert not list((built.folder / ".checkpoints").glob("*"))


def test_the_reports_say_that_every_study_is_simulated(built):
    for study in ("campus", "town", "suburb"):
        folder = built.folder / f"artifacts/report/{study}/10m"
        assert "simulated" in (folder / "report.md").read_text().lower()
        assert all("simulated, not recorded" in path.read_text() for path in folder.glob("*.svg"))
    assert built.run("yearloc", "results").lower().count("simulated") >= 3


def test_the_table_tells_of_each_perturbation_and_stress_and_every_model(built):
    table = pd.read_json(
        io.StringIO(
            built.run("yearloc", "results", "--json", "--where", "study=town", "protocol=cells")
        )
    )
    own = table[(table["grid"] == "10m") & (table["number"] == "auc_top1")]
    turned = own[own["of"] == "turned"]
    models = {("sci", ""), ("scan_context", ""), ("scan_context", "engaged")}
    assert set(zip(turned["method"], turned["variant"], strict=True)) == models
    assert turned["repeat"].nunique() == 5
    unperturbed = own["ask"].isin(["unperturbed", "stress"])
    driven = own[(own["model"] == "sci") & unperturbed].set_index("sequence")["value"]
    shown = json.loads(
        built.run("dvc", "metrics", "show", "--json", "artifacts/metrics/town/10m/sci")
    )[""]["data"]
    found = {Path(path).stem: of["data"]["auc_top1"] for path, of in shown.items()}
    assert driven.to_dict() == pytest.approx(found)
    assert set(found) == {"2014-11-25-09-18-32", "2015-09-05-14-30-00"}
    assert set(table["grid"]) == {"5m", "10m"}


def test_the_page_holds_every_section_of_the_studies(built):
    page = (built.folder / "artifacts/report/page.html").read_text()
    town = ("town-10m-turned", "town-10m-stress", "town-10m-events", "town-cells")
    for name in (
        *town,
        "campus-10m-ageing",
        "campus-10m-poses",
        "campus-10m-glance",
        "suburb-10m-viewpoints",
    ):
        assert f'id="{name}"' in page


def test_viewpoints_are_reported_by_heading_in_files_and_in_mlflow(built):
    (path,) = (built.folder / "artifacts/metrics/suburb/10m/viewpoints/sad").iterdir()
    assert path.name == "00.json"
    reported = built.run(
        "yearloc", "results", "--json", "--where", "study=suburb", "number=accuracy", "sequence=00"
    )
    table = pd.read_json(io.StringIO(reported))
    assert json.loads(path.read_text())["accuracy"] == pytest.approx(table["value"].mean())
    assert len(table) >= 8  # headings
    with closing(sqlite3.connect(built.folder / "mlflow.db")) as database:
        steps = database.execute(
            "select step from metrics where key = 'viewpoints/accuracy 2012-06-15'"
        ).fetchall()
    assert sorted(step for (step,) in steps) == sorted([22, 67, 112, 157, 202, 247, 292, 337])


def test_a_model_of_the_chain_learns_its_day_street_by_street(built, tmp_path):
    town = yaml.safe_load((built.folder / "conf/studies.yaml").read_text())["studies"]["town"]
    days = f"train='{town['train']}'", f"query_days='{town['tests'][0]}'"
    course = (
        "study=town",
        "simulated=true",
        "cells=10m",
        "method=scan_context",
        "name={method: scan_context}",
        "order=streets",
        "strategy=incremental",
        "view_name=scan_context",
    )
    paths = (
        "model=artifacts/train/town/10m/scan_context.zarr.zip",
        "labels=artifacts/labels/town/10m",
        "views=artifacts/views/town/scan_context",
        "scans=artifacts/scans/town",
        "submaps=artifacts/submaps/town",
        "map=artifacts/map/town",
        f"out={tmp_path}/incremental.zarr",
        f"timing={tmp_path}/incremental.json",
    )
    line = built.run("python", "-m", "stages.lifelong", *course, *days, *paths)
    assert re.search(r"lifelong: 4 steps to \d+ places: of \d+ queries in learned places", line)
    artifact = store.read(tmp_path / "incremental.zarr", Lifelong)
    assert artifact.attrs["places"] == sorted(artifact.attrs["places"])
    assert artifact.load("right").sum(axis=1).argmax() > 0  # more is answered once more is known
    assert len(json.loads((tmp_path / "incremental.json").read_text())["cpu_s"]) == 4


STAGES = {
    "processes": ("scans", "localize"),
    "cluster": (
        "scans",
        "submaps",
        "views",
        "birdviews",
        "perturbed",
        "localize",
        "evaluate",
        "paths",
        "poses",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("way", STAGES)
def test_processes_and_a_scheduler_with_two_workers_give_the_bytes_of_threads(
    built, tmp_path, monkeypatch, way
):
    monkeypatch.setenv("YEARLOC_COMPUTE", way)
    recorded = DvcLock.read(built.folder / "dvc.lock").stages
    workers = 2 if way == "cluster" else 0
    with LocalCluster(
        workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", cluster.scheduler_address)
        for stage in STAGES[way]:
            entry = next(entry for name, entry in recorded.items() if name.startswith(f"{stage}@"))
            built.run(*shlex.split(re.sub(r"\b(out|metrics)=", rf"\1={tmp_path}/", entry["cmd"])))
            assert all((tmp_path / out["path"]).exists() for out in entry["outs"])
    assert Clone(tmp_path, built="{}").digests().items() <= built.digests().items()


def test_a_second_run_runs_nothing_whatever_the_clock_says(built):
    """Outputs and sources get dates in the future and in the past: DVC goes by their content."""
    for number, folder in enumerate(("artifacts", "conf", "pipeline", "stages", "dag")):
        for path in (built.folder / folder).rglob("*"):
            os.utime(path, (year_s := (4e9, 1e9)[(number + len(path.name)) % 2], year_s))
    assert built.repro() == []


EDITS = {
    "of one stage each": [
        ("conf/method/sci.yaml", "n_way: 2", "n_way: 4", {"train", "localize"}),
        ("conf/viewpoints.yaml", "correct_m: 10.0", "correct_m: 5.0", {"viewpoints"}),
        ("conf/grid/10m.yaml", "10.0", "12.0", {"labels"}),
        ("conf/submap/single.yaml", "1.0", "2.0", {"submaps"}),
        ("conf/dataset/town.yaml", "lift_m: 0.0", "lift_m: 1.0", {"scans"}),
        ("conf/world/campus_tiny.yaml", "seed: 0", "seed: 1", {"logs"}),
        ("conf/tolerance/15m.yaml", "seen_m: 5.0", "seen_m: 6.0", {"evaluate"}),
        ("conf/results.yaml", "level: 0.95", "level: 0.9", {"results"}),
        (
            "pipeline/report/templates/words.yaml",
            "recorded: Recorded data",
            "recorded: Recorded numbers",
            {"report"},
        ),
    ],
    "views, and how a figure looks": [
        ("conf/view/scan_context.yaml", "rings: 16", "rings: 20", {"views", "perturbed", "poses"}),
        ("conf/view/birdview_campus.yaml", "depth: 7", "depth: 6", {"birdviews", "perturbed"}),
        (
            "pipeline/report/figures/style.py",
            "simulated, not recorded",
            "simulated, never recorded",
            {"report"},
        ),
    ],
    "a world, poses, turned queries": [
        ("conf/world/town_tiny.yaml", "seed: 1", "seed: 2", {"logs", "events"}),
        ("conf/poses.yaml", "k: 25", "k: 20", {"poses"}),
        ("conf/path/graph_all.yaml", "fix_m: 0.1", "fix_m: 0.2", {"paths"}),
        ("conf/perturbation/turned.yaml", "repeats: 5", "repeats: 4", {"perturbed"}),
    ],
    "a colour": [("pipeline/studies/colours.py", "#004087", "#004088", {"report", "publish"})],
    "what must not change a result": [
        ("conf/compute/threads.yaml", "workers: 0", "workers: 1", set()),
        ("conf/tracking/local.yaml", "5000", "5001", set()),
    ],
}
"""Edits that are made together, since DVC takes seconds to look at the chain: the stages of
each."""


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS)
def test_edits_touch_exactly_their_stages(built, edits):
    before = {path: built.edit(path, old, new) for path, old, new, _ in edits}
    try:
        assert {stage.partition("@")[0] for stage in built.outdated()} == set().union(
            *(stages for *_, stages in edits)
        )
    finally:
        for path, text in before.items():
            (built.folder / path).write_text(text)


def test_poses_are_a_variant_in_the_table_and_place_what_the_model_cannot(built):
    table = results.read(Layout(built.folder / "artifacts"), {"campus": made_study()})
    own = table[
        (table["method"] == "scan_context")
        & (table["ask"] == "unperturbed")
        & (table["protocol"] == "distance")
    ]
    values = own.set_index(["variant", "number", "sequence"])["value"].sort_index()
    assert set(own["variant"]) == {"", "pose", "pose-filter", "pose-graph_all"}
    assert (
        values["pose", "recall_at_1"] > values["", "recall_at_1"]
    ).all()  # tiny training; walls find the places
    assert (values["pose", "within_2m_5deg"] > 0.6).all()
    assert "within_2m_5deg" not in values[""].index
    # Validation queries are too few for a verdict here; odometry carries the poses that were found
    # to queries without one.
    for path in ("filter", "graph_all"):
        assert (values[f"pose-{path}", "within_2m_5deg"] >= values["pose", "within_2m_5deg"]).all()
    perturbed = table[
        (table["variant"] == "pose")
        & (table["number"] == "within_2m_5deg")
        & (table["protocol"] == "distance")
    ]
    found = perturbed[perturbed["ask"] == "perturbed"].set_index("of")["value"]
    assert set(found.index) == {"turned", "demolition", "construction"}
    assert found["turned"] > 0.6  # its ground truth is turned with it
    assert not (built.folder / "artifacts/report/campus/10m/history_scan_context-pose.svg").exists()


def test_failures_are_drawn_from_a_studys_own_poses(built, tmp_path):
    for model, day in (("scan_context", "2012-06-15"), ("scan_context-pose-filter", "2012-10-28")):
        out = built.run(
            "yearloc",
            "failures",
            f"campus/10m/{model}",
            day,
            "-o",
            str(tmp_path),
            "--worst",
            "2",
            "--target-precision",
            "none",
        )
        assert f"{tmp_path}: " in out
        poses = (
            "paths/campus/10m/scan_context-pose-filter"
            if "filter" in model
            else "poses/campus/10m/scan_context"
        )
        artifact = store.read(built.folder / "artifacts" / poses / f"{day}.zarr", schemas.Fixes)
        driven = len(artifact.load("novelty")) // len(artifact.attrs["cases"])
        known = np.isfinite(artifact.load("world_T_query")[:driven]).all((1, 2)).sum()
        assert f": of {known} poses " in out
