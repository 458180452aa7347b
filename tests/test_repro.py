"""`yearloc repro` counts stages and estimates what is left."""

import os
import re
import stat
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import psutil
import pytest

from pipeline.cli import main
from pipeline.cli.repro import USUAL_S, Counting, count_instances

STAGES = {
    "dvc.yaml": "report: {foreach: '${lists.report}'}",
    "dag/train/dvc.yaml": "train: {foreach: '${lists.models}'}",
}
DVC = """#!/bin/sh
echo "Stage 'dag/train/dvc.yaml:train@a' didn't change, skipping"
echo "Running stage 'dag/train/dvc.yaml:train@b':"
echo "$@"
echo "ERROR: failed" >&2
exit 3
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of two models and a report, and a `dvc` that fails at the second model."""
    for name, text in STAGES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"stages:\n  {text}\n")
    (tmp_path / "conf/dataset").mkdir(parents=True)
    (tmp_path / "conf/studies.yaml").write_text("studies: {}\n")
    (tmp_path / "conf/lists.yaml").write_text(
        "lists:\n  models: {a: 1, b: 1}\n  report: {all: 1}\n"
    )
    (tmp_path / "bin").mkdir()
    dvc = tmp_path / "bin/dvc"
    dvc.write_text(DVC)
    dvc.chmod(dvc.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{dvc.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_stages_are_counted_and_the_exit_code_is_dvcs(
    project: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["repro"])
    assert ended.value.code == 3
    shown = capfd.readouterr()
    assert "[2/3] Running stage 'dag/train/dvc.yaml:train@b':\nrepro\n" in shown.out
    assert "ERROR: failed" in shown.err


def test_asked_to_end_it_ends_the_stage_under_way(project: Path) -> None:
    """Without that the stage writes on, and the next repro runs a second one beside it."""
    (project / "bin/dvc").write_text("#!/bin/sh\nsh -c 'echo $$ > stage; exec sleep 60'\n")
    repro = subprocess.Popen(
        [sys.executable, "-c", "from pipeline.cli import main; main(['repro'])"], cwd=project
    )
    for _ in range(300):
        if (project / "stage").is_file() and (project / "stage").read_text():
            break
        time.sleep(0.1)
    stage = psutil.Process(int((project / "stage").read_text()))
    repro.terminate()
    assert repro.wait(timeout=30) == 143
    assert not stage.is_running()


def test_without_dvc_it_says_what_to_do(
    project: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(project))
    with pytest.raises(SystemExit):
        main(["repro"])
    assert "dvc: not found; `source .venv/bin/activate` first" in capfd.readouterr().err


def test_what_is_left_takes_as_long_as_the_stages_of_its_kind_took(project: Path) -> None:
    """Trainings of 60 s are a pace of 60 / 45: three more of 60 s and a report of 18 s · 4 / 3 are
    204 s. After one of 100 s the pace is 160 / 90, and two of (2 · 80 + 160) / 4 s and a report of
    32 s are 192 s."""
    counting = Counting(count_instances(project) + Counter(train=2))  # four models now
    lines = [
        counting.line(f"Running stage 'dag/train/dvc.yaml:train@{name}':\n", at)
        for name, at in (("a", 0), ("b", 60), ("c", 160))
    ]
    assert [line.partition(" Running")[0] for line in lines] == [
        "[1/5]",
        "[2/5, about 3 min left]",
        "[3/5, about 3 min left]",
    ]
    assert counting.line("any other line\n", 170) == "any other line\n"


def test_what_is_left_does_not_jump_where_quick_stages_come_before_long_ones() -> None:
    """A machine twice as slow as usual: the estimate is never a fifth off what then remains."""
    order = ["logs", "scans", "scans", "labels", "train", "train", "localize", "report"]
    counting = Counting(Counter(order))
    now_s = 0.0
    for row, stage in enumerate(order):
        line = counting.line(f"Running stage '{stage}@a':\n", now_s)
        left_s = sum(2 * USUAL_S[later] for later in order[row:])
        if row:
            number, unit = re.findall(r"about (\d+) (min|s) left", line)[0]
            assert float(number) * (60 if unit == "min" else 1) == pytest.approx(left_s, rel=0.2)
        now_s += 2 * USUAL_S[stage]


def test_without_lists_lines_are_left_as_they_are(tmp_path: Path) -> None:
    assert (
        Counting(count_instances(tmp_path)).line("Running stage 'a@b':\n", 0)
        == "Running stage 'a@b':\n"
    )
