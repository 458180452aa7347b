"""A stage's function, as a shell and as another stage runs it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from pipeline.errors import InputError
from pipeline.running.telemetry import Trace
from stages import ROOT, stage
from stages.sweep.settings import Composer
from stages.train import within_budget


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@stage("views")
def main(cfg: DictConfig) -> str:
    """Draw."""
    if cfg.fails:
        raise InputError("no")
    return f"{cfg.out} drawn"


def test_the_function_runs_in_process_without_a_line_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(OmegaConf.create({"out": "artifacts/a", "fails": False})) == "artifacts/a drawn"
    assert capsys.readouterr() == ("", "")


def test_a_stage_leaves_its_trace_beside_its_artifact() -> None:
    main.run(OmegaConf.create({"out": "artifacts/a", "fails": False}))
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert trace.wall_s >= 0


def test_a_stage_without_an_artifact_leaves_no_trace(tmp_path: Path) -> None:
    main.run(OmegaConf.create({"out": None, "fails": False}))
    assert not list(tmp_path.iterdir())


def test_errors_stay_as_they_are_in_process(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no"):
        main.run(OmegaConf.create({"out": "artifacts/a", "fails": True}))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("given", "found"), [({}, "passive"), ({"OMP_WAIT_POLICY": "active"}, "active")])
def test_waiting_threads_sleep_unless_the_environment_says_otherwise(given: dict[str, str], found: str) -> None:
    env = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"} | given
    code = "import sys, os, stages; print(os.environ['OMP_WAIT_POLICY'], 'torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=env, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [found, "False"]
