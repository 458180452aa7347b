"""A stage's function, as a shell and as another stage runs it."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import Count, Names
from pipeline.running.telemetry import Trace
from pipeline.sweeps.chain import Step
from stages import ROOT, stage, within_budget
from stages.sweep.settings import Composer


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@dataclass(frozen=True)
class Settings:
    fails: bool
    out: Path | None = None
    names: Names = ()
    k: Count = 25


@stage("views")
def main(settings: Settings) -> str:
    """Draw."""
    if settings.fails:
        raise InputError("no")
    return f"{settings.out} drawn"


def test_in_process_it_prints_no_line_and_leaves_its_trace_beside_its_artifact(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main.run(OmegaConf.create({"out": "artifacts/a", "fails": False})) == "artifacts/a drawn"
    assert capsys.readouterr() == ("", "")
    trace = Trace.read("artifacts/a")
    assert trace is not None
    assert trace.wall_s >= 0


def test_a_stage_without_an_artifact_leaves_no_trace(tmp_path: Path) -> None:
    main.run(OmegaConf.create({"out": None, "fails": False}))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("table", "refusal"),
    [
        ({"fails": None}, "not given: fails; `dvc repro` gives what a stage needs"),
        ({"fails": 3}, "fails=3: expected true or false"),
        ({"fails": True, "k": 0}, "k=0: expected a number above 0"),
        ({"fails": True, "names": 3}, "names=3: expected a list"),
    ],
)
def test_a_setting_that_its_dataclass_refuses_is_named(table: dict[str, Any], refusal: str) -> None:
    with pytest.raises(ConfigError, match=f"^{refusal}$"):
        main.run(OmegaConf.create(table))


def test_errors_stay_as_they_are_in_process(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no"):
        main.run(OmegaConf.create({"out": "artifacts/a", "fails": True}))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "found"), [({}, "passive"), ({"OMP_WAIT_POLICY": "active"}, "active")]
)
def test_waiting_threads_sleep_unless_the_environment_says_otherwise(
    given: dict[str, str], found: str
) -> None:
    env = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"} | given
    code = "import sys, os, stages; print(os.environ['OMP_WAIT_POLICY'], 'torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [found, "False"]


@pytest.mark.parametrize(
    ("overrides", "width", "batch", "share"),
    [
        ([], 8, 32, 0.01),
        (["method.width=64"], 64, 32, 0.01),  # what conf/method/pfl.yaml says anyway
        (["method.width=16", "++method.batch=4"], 16, 4, 0.01),
        (["budget.pfl.width=16"], 16, 32, 0.01),
        (["budget.share=0.5"], 8, 32, 0.5),
    ],
)
def test_what_the_command_line_sets_wins_over_the_budget(
    overrides: list[str], width: int, batch: int, share: float
) -> None:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        words = ["method=pfl", "budget=demo", *overrides]
        cfg = within_budget(compose("train", words), words)
    assert (cfg.method.width, cfg.method.batch, cfg.budget) == (width, batch, {"share": share})
    assert within_budget(cfg, words) == cfg


@pytest.mark.parametrize(("width", "usual"), [(8, True), (64, False)])
def test_a_sweep_over_a_field_that_the_budget_sets_is_what_it_says(width: int, usual: bool) -> None:
    """In conf/method/pfl.yaml it is 64, and 8 in conf/budget/demo.yaml, which a study is trained
    with."""
    files = {f"conf/{file}.yaml": () for file in ("train", "method/pfl", "budget/demo")}
    step = Step("train", "python -m stages.train method=pfl budget=demo", (), files, ())
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composer = Composer({"method.width": str(width)})
        values, found = composer.settings(step)
        assert composer.config(step, {}).method.width == width
    assert (values["method"]["width"], found) == (width, usual)


FILLED = """
import resource, sys
import numpy as np
from omegaconf import OmegaConf
from pipeline.core import store
from dataclasses import dataclass
from stages import stage

@dataclass(frozen=True)
class Settings:
    out: str

@stage("latency")
def main(settings: Settings) -> str:
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # a disk that is full after 20 kB
    store.write_model(sys.argv[0] + ".zarr.zip", {"a": np.zeros(99_999)}, {})

@stage("latency")
def write(settings: Settings) -> str:
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    open(sys.argv[0] + ".txt", "wb").write(bytes(99_999))

@stage("latency")
def stopped(settings: Settings) -> str:
    raise KeyboardInterrupt

@stage("latency")
def large(settings: Settings) -> str:
    np.zeros((10**9, 10**9))
"""


@pytest.mark.parametrize(
    ("which", "code", "said"),
    [
        ("main", 1, "cannot be written (.*)"),
        ("write", 1, "file too large; fix that and run it again"),
        ("stopped", 130, "interrupted"),
        ("large", 1, "not enough memory: fewer workers or a smaller view need less"),
    ],
)
def test_what_the_machine_refuses_is_one_line(
    tmp_path: Path, which: str, code: int, said: str
) -> None:
    words = ["out=a", "samples=b", "study=campus"]
    command = [
        sys.executable,
        "-c",
        f"{FILLED}\nsys.argv[0] = {str(tmp_path / 'out')!r}\n{which}()",
        *words,
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    assert re.fullmatch(rf"latency: (.*: )?{said}\n", done.stderr)


@pytest.mark.parametrize(
    "target", ["os.system", "builtins.eval", "pipeline.core.store.Path", "pipeline.cli.os.system"]
)
def test_no_other_class_is_built_than_this_projects(target: str) -> None:
    with pytest.raises(
        ConfigError, match=f"^_target_={target}: expected a class of pipeline or worlds$"
    ):
        main.run(
            OmegaConf.create(
                {"out": None, "fails": False, "view": {"parts": [{"_target_": target}]}}
            )
        )
