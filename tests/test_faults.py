"""Damaged artifacts, strange words on the command line and stopped commands are refused in one line
or harmless. With FAULTS=100 in the environment a hundred times as many are tried."""

import io
import os
import random
import shutil
import signal
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import faults
from pipeline.cli import main
from pipeline.core import store
from pipeline.core.errors import YearlocError
from pipeline.inspection.dictionary import KINDS
from pipeline.running.texts import read_yaml
from tests.clone import ROOT
from tests.inspection.test_artifacts import write
from tests.readers.damage import damaged

FAULTS = int(os.environ.get("FAULTS", "1"))
COUNT = count()


def read(path: Path) -> Any:
    """What an artifact or a model holds."""
    if path.suffix == ".zarr":
        artifact = store.read(path, *KINDS.values())
        return artifact.attrs, {name: artifact.load(name).tobytes() for name in artifact.columns}
    model = store.read_model(path)
    return store.read_recipe(path), {name: array.tobytes() for name, array in model.items()}


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """An artifact and a model."""
    folder = tmp_path_factory.mktemp("sealed")
    write(folder / "a.zarr", "labels")
    store.write_model(folder / "a.zarr.zip", {"a": np.arange(9.0)}, {"k": 1})
    return [folder / "a.zarr", folder / "a.zarr.zip"]


@given(data=st.data())
@settings(max_examples=60 * FAULTS)
def test_a_damaged_artifact_is_refused_or_as_it_was(
    sealed: list[Path], data: st.DataObject
) -> None:
    path = data.draw(st.sampled_from(sealed))
    right = read(path)
    files = sorted(file for file in path.rglob("*") if file.is_file()) or [path]
    file = data.draw(st.sampled_from(files))
    before = file.read_bytes()
    file.write_bytes(data.draw(damaged(before)))
    refusal = ""
    try:
        assert read(path) == right
    except YearlocError as error:
        refusal = str(error).strip()
    finally:
        file.write_bytes(before)
    assert "\n" not in refusal


COMMANDS = """
use campus world=tiny methods=sci,m2dp tests=2012-10-28 experiment=robustness variants=4way --add
use campus cells=5m perturbed=turned methods=sci_ring poses=sci_ring paths=filter seeds=2 budget=tiny experiment=robustness
use campus world=tiny experiment=lifelong --keep
use folder root=logs train=a tests=b scale=indoor
use folder root=logs split=path:2 log=a
use suburb experiment=viewpoints methods=pfl
use kitti root=logs log=00 train=02
fetch nclt 2012-01-15 root=there base=http://127.0.0.1:9/
inspect conf/studies.yaml --format nclt --save conf/dataset/robot.yaml
inspect scan.npy
results --full --csv --json --markdown --where method=sci study=campus
repro
methods
repair
pack campus/10m/sci_ring -o a.site
localize a.site scan.npy --json -o fixes --target-precision 0.99 --lift 0 --topic /points --odometry tf:a>b --track --threads 1
localize a.site a.mcap --follow --idle 1
export a.site -o a.onnx
serve a.site --port 8765 --host 127.0.0.1 --workers 1 --zenoh tcp/127.0.0.1:7447 --key yearloc
watch a.site scan.npy --save a.rrd --target-precision 0.99 --every 1
failures campus/10m/sci_ring 2012-02-04 --worst 20 -o failures --target-precision 0.99
picture campus/10m/sci_ring 2012-02-04 -o a.gif
update a.site scan.npy -o b.site --poses log --target-precision 0.99 --topic /points --odometry tf:a>b
"""
VALUES = """
-1 0 1e999 nan true null ~ [1] {} {0} %s é ⛄ 0x10 -o , = - -- ' " $(id) `id` http:// http://[ http://127.0.0.1:9/%
.. . / // a/b a/b/c ../conf conf /dev/null nowhere/at/all
"""
HOSTILE = (
    *("", " ", "\n", "a b", "\x1b[31m", "\x7f\x01", "\udcff", "a" * 5_000, "10" * 40),
    *VALUES.split(),
)
KEYS = sorted({str(key) for path in (ROOT / "conf").rglob("*.yaml") for key in read_yaml(path)})
EVER_S = 60


@st.composite
def changed(draw: st.DrawFn) -> list[str]:
    """A command with some words left out and up to two changed, mostly values."""
    command, *rest = draw(st.sampled_from(COMMANDS.strip().splitlines())).split()
    words = [word for word in rest if draw(st.integers(0, 9))]
    for _ in range(draw(st.integers(0, 2))):
        values = [at for at, word in enumerate(words) if not word.startswith("-")]
        at = draw(st.sampled_from(values)) if values else 0
        value = draw(st.sampled_from(HOSTILE))
        old = words[at] if values else ""
        key, equals, _ = old.partition("=")
        other = draw(damaged(old.encode(errors="surrogateescape") or b" "))
        word = other.decode(errors="surrogateescape").replace("\0", "")
        some = [f"{key}={value}"] if equals else [value]
        more = [old, f"{draw(st.sampled_from(KEYS))}={value}"]
        words[at : at + 1] = draw(st.sampled_from((some, some, some, [word], more, [old, value])))
    return [command, *words]


def project(folder: Path) -> Path:
    """What the commands read of a project, with a scan; an unreached server is not waited for."""
    for name in ("conf", "dag"):
        shutil.copytree(ROOT / name, folder / name, symlinks=True)
    for path in (folder / "conf/fetch").glob("*.yaml"):
        path.write_text(path.read_text().replace("wait_s: 1.0", "wait_s: 0.001"))
    shutil.copy(ROOT / "dvc.yaml", folder)
    np.save(folder / "scan.npy", np.eye(3, dtype=np.float32))
    for name in ("a", "b"):
        (folder / f"logs/{name}/scans").mkdir(parents=True)
        shutil.copy(folder / "scan.npy", folder / f"logs/{name}/scans/1.0.npy")
        (folder / f"logs/{name}/poses.txt").write_text("1.0 0 0 0 0 0 0 1\n")
    return folder


def late(*_: object) -> None:
    raise TimeoutError(f"not within {EVER_S} s")


@given(words=changed())
@settings(max_examples=24 * FAULTS)
def test_strange_words_are_refused_in_one_line_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, words: list[str]
) -> None:
    """Without artifacts, a network and DVC."""
    proxies = ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY")
    alone = dict.fromkeys(proxies, "http://127.0.0.1:9") | {"PATH": ""}
    err = io.StringIO()
    signal.signal(signal.SIGALRM, late)
    signal.alarm(EVER_S)
    with (
        chdir(project(tmp_path_factory.mktemp(f"words{next(COUNT)}"))),
        patch.dict(os.environ, alone),
        patch.object(sys, "stdin", None),
        redirect_stdout(io.StringIO()),
        redirect_stderr(err),
        suppress(SystemExit),
    ):
        main(words)
    signal.alarm(0)
    assert "Traceback" not in err.getvalue()


def test_a_fetch_that_is_stopped_ends_as_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    rngs = map(random.Random, range(3))
    commands = {"fetch": faults.COMMANDS["fetch"]}
    cases = list(faults.command_stops(tmp_path, rngs, commands))
    assert [case.ending for case in cases] == ["same", "same", "same"]
    assert len(list((tmp_path / "fetched/made/made").iterdir())) == 200
    assert not (tmp_path / "conf/fetch/made.yaml").exists()
