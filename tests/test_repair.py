"""What a further sequence and a kill cost a chain; each test builds its own."""

import os
import signal
import subprocess
import time

import yaml

from tests.clone import BIN, Clone


def test_a_new_test_sequence_trains_nothing_and_drives_only_itself(built, tmp_path):
    twin = built.twin(tmp_path)
    path = tmp_path / "conf/studies.yaml"
    studies = yaml.safe_load(path.read_text())["studies"]
    new = "2012-02-04"
    studies["campus"]["tests"].append(new)
    del studies["campus"]["methods"][1:], studies["campus"]["poses"], studies["campus"]["paths"]
    path.write_text(yaml.safe_dump({"studies": studies}))
    twin.run("yearloc", "use")
    ran = twin.repro()
    own = {f"{stage}@campus-{new}" for stage in ("logs", "scans")}
    assert {stage for stage in ran if stage.partition("@")[0] in ("logs", "scans")} == own
    asked = {
        "submaps",
        "views",
        "altered",
        "labels",
        "localize",
        "evaluate",
        "results",
        "report",
        "latency",
        "publish",
    }
    # an empty folder stands where the study has no poses any more
    assert {stage.partition("@")[0] for stage in set(ran) - own} - {"absent"} == asked
    assert not [stage for stage in ran if "town" in stage]


def test_a_kill_at_any_moment_is_repaired_by_the_next_run(built, tmp_path):
    """The group is killed once in the simulation and once in training; the artifacts end bit for
    bit as undisturbed."""
    clone = Clone(tmp_path)
    clone.draw_small()
    clone.run(
        "yearloc", "use", "campus", "world=tiny", "tests=2012-06-15", "methods=sci", "latency=no"
    )
    for sign in ("artifacts/logs/campus/.2012-06-15.*.scratch", ".checkpoints/*.safetensors"):
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        running = subprocess.Popen(
            [str(BIN / "dvc"), "repro"],
            cwd=tmp_path,
            env=clone.env,
            start_new_session=True,
            **silent,
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
    of_all = (
        "/results/",
        "/report/",
        "/latency/",
        ".json",
    )  # what tells of all tests, and of the clock
    found = {
        path: digest
        for path, digest in clone.digests().items()
        if not any(word in path for word in of_all)
    }
    assert len({path.split("/")[1] for path in found}) == 9
    assert found.items() <= built.undisturbed.items()
    assert not list(tmp_path.rglob("*.scratch"))
