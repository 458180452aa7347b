"""The whole chain at its smallest: what runs, what does not run again, and what a kill costs."""

import os
import signal
import subprocess
import time

import pytest
import yaml

from tests.clone import BIN, Clone


def test_every_stage_runs_once_and_leaves_its_artifact(built):
    kinds = {stage.partition("@")[0] for stage in built.ran}
    assert kinds == {"logs", "scans", "submaps", "views", "labels", "train", "localize", "evaluate", "report", "publish"}
    assert len(built.ran) == len(set(built.ran)) == 3 * 5 + 1 + 2 + 2 + 1 + 1
    assert not list(built.folder.rglob("*.scratch"))
    assert not list((built.folder / ".checkpoints").glob("*"))


def test_the_report_says_that_the_campus_is_simulated(built):
    folder = built.folder / "artifacts/report/campus/10m"
    assert "simulated" in (folder / "report.md").read_text().lower()
    assert all("simulated campus" in path.read_text() for path in folder.glob("*.svg"))
    assert "simulated" in built.run("yearloc", "results")


def test_a_second_run_runs_nothing(built):
    assert built.repro() == []


@pytest.mark.parametrize(
    ("path", "old", "new", "stages"),
    [
        ("conf/method/sci.yaml", "n_way: 2", "n_way: 4", {"train", "localize"}),
        ("conf/method/sci.yaml", "colormap: jet", "colormap: grey", {"train", "localize"}),
        ("conf/view/scan_context.yaml", "rings: 40", "rings: 20", {"views"}),
        ("conf/grid/10m.yaml", "10.0", "12.0", {"labels"}),
        ("conf/submap/single.yaml", "1.0", "2.0", {"submaps"}),
        ("conf/world/tiny.yaml", "seed: 0", "seed: 1", {"logs"}),
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


def test_a_new_test_sequence_costs_its_own_stages_only(built):
    path = built.folder / "conf/benchmark.yaml"
    before = path.read_text()
    names = yaml.safe_load(before)
    new = "2012-02-04"
    for group in ("tests", "sequences"):
        names["benchmark"][group].append(new)
    path.write_text(yaml.safe_dump(names))
    try:
        ran = built.repro()
    finally:
        path.write_text(before)
    own = {f"{stage}@{new}" for stage in ("logs", "scans", "submaps")}
    own |= {f"views@scan_context-{new}", f"labels@10m-{new}", f"localize@10m-method0-{new}", f"evaluate@10m-method0-{new}"}
    assert set(ran) == own | {"report@10m", "publish"}


def test_a_kill_at_any_moment_is_repaired_by_the_next_run(built, tmp_path):
    """The group is killed once in the simulation and once in training; the artifacts end bit for bit as undisturbed."""
    clone = Clone(tmp_path)
    clone.run("yearloc", "use", "campus", "world=tiny")
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
    assert clone.digests() == built.undisturbed
    assert not list(tmp_path.rglob("*.scratch"))
