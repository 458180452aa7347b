"""Words on the command line that nobody should say: changed ones, hostile values, paths that are
not there.

Every command is called in a copy of the project's settings, without artifacts, a network and DVC.
"""

import os
import random
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.faults import mutated, shown
from pipeline.core.errors import YearlocError
from pipeline.running.texts import read_yaml

SAID = (
    "use campus world=tiny methods=sci,m2dp tests=2012-10-28 question=robustness variants=4way "
    "--add",
    "use campus cells=5m altered=turned methods=sci_ring poses=sci_ring paths=filter seeds=2 "
    "budget=tiny question=robustness",
    "use campus world=tiny question=lifelong --keep",
    "use folder root=logs train=a tests=b scale=indoor",
    "use folder root=logs parts=path:2 log=a",
    "use suburb question=viewpoints methods=pfl",
    "use kitti root=logs log=00 train=02",
    "fetch nclt 2012-01-15 root=there base=http://127.0.0.1:9/",
    "inspect conf/studies.yaml --format nclt --save conf/dataset/robot.yaml",
    "inspect scan.npy",
    "results --full --csv --json --markdown --where method=sci study=campus",
    "repro",
    "methods",
    "repair",
    "pack campus/10m/sci_ring -o a.site",
    "localize a.site scan.npy --json -o fixes --promise 0.99 --lift 0 --topic /points --odometry "
    "tf:a>b --track --threads 1",
    "localize a.site a.mcap --follow --idle 1",
    "export a.site -o a.onnx",
    "serve a.site --port 8765 --host 127.0.0.1 --workers 1 --zenoh tcp/127.0.0.1:7447 --key "
    "yearloc",
    "watch a.site scan.npy --save a.rrd --promise 0.99 --every 1",
    "failures campus/10m/sci_ring 2012-02-04 --worst 20 -o failures --promise 0.99",
    "picture campus/10m/sci_ring 2012-02-04 -o a.gif",
    "grow a.site scan.npy -o b.site --poses log --promise 0.99 --topic /points --odometry tf:a>b",
)
VALUES = """
-1 0 1e999 nan true null ~ [1] {} {0} %s é ⛄ 0x10 -o , = - -- ' " $(id) `id` http:// http://[ http://127.0.0.1:9/%
.. . / // a/b a/b/c ../conf conf /dev/null nowhere/at/all
"""
HOSTILE = (
    "",
    " ",
    "\n",
    "a b",
    "\x1b[31m",
    "\x7f\x01",
    "\udcff",
    "a" * 5_000,
    "10" * 40,
    *VALUES.split(),
)
EVER_S = 60


def cases(project: Path, number: int, seed: int, done: int) -> Iterator[dict[str, Any]]:
    """Call each command with a few of its words changed."""
    keys = sorted(
        {str(key) for path in (project / "conf").rglob("*.yaml") for key in read_yaml(path)}
    )
    nowhere = dict.fromkeys(
        ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9"
    )
    for case in range(done, number):
        rng = random.Random(f"{seed} words {case}")
        words = _changed(rng.choice(SAID).split(), keys, rng)
        alone = patch.dict(os.environ, {**nowhere, "PATH": ""})
        with (
            TemporaryDirectory() as scratch,
            chdir(_copied(project, Path(scratch))),
            alone,
            patch.object(sys, "stdin", None),
        ):
            ending, said = _ended(words)
        yield {"case": case, "file": " ".join(words)[:300], "ending": ending, "said": said[-300:]}


def _changed(words: list[str], keys: list[str], rng: random.Random) -> list[str]:
    """The command with some words left out and up to two changed, mostly values: a strange option
    alone only typer sees."""
    command, *rest = words
    words = [word for word in rest if rng.random() < 0.9]
    for _ in range(rng.choice((0, 1, 1, 2))):
        values = [at for at, word in enumerate(words) if not word.startswith("-")]
        at = rng.choice(values) if values else 0
        value = rng.choice(HOSTILE)
        old = words[at] if values else ""
        key, equals, _ = old.partition("=")
        other = (
            mutated(old.encode(errors="surrogateescape"), rng)
            .decode(errors="surrogateescape")
            .replace("\0", "")
        )
        some = [f"{key}={value}"] if equals else [value]
        words[at : at + 1] = rng.choice(
            (some, some, some, [other], [other], [old, f"{rng.choice(keys)}={value}"], [old, value])
        )
    return [command, *words]


def _copied(project: Path, scratch: Path) -> Path:
    """What the commands read of a project, with a scan; an unreached server is not waited for."""
    for name in ("conf", "dag"):
        shutil.copytree(project / name, scratch / name, symlinks=True)
    for path in (scratch / "conf/fetch").glob("*.yaml"):
        path.write_text(
            path.read_text(encoding="utf-8").replace("wait_s: 1.0", "wait_s: 0.001"),
            encoding="utf-8",
        )
    shutil.copy(project / "dvc.yaml", scratch)
    np.save(scratch / "scan.npy", np.eye(3, dtype=np.float32))
    for name in ("a", "b"):
        (scratch / f"logs/{name}/scans").mkdir(parents=True)
        shutil.copy(scratch / "scan.npy", scratch / f"logs/{name}/scans/1.0.npy")
        (scratch / f"logs/{name}/poses.txt").write_text("1.0 0 0 0 0 0 0 1\n", encoding="utf-8")
    return scratch


def _ended(words: list[str]) -> tuple[str, str]:
    def late(*_: object) -> None:
        raise TimeoutError(f"not within {EVER_S} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(EVER_S)
    try:
        shown(words)
    except YearlocError as error:
        return "refused", str(error)
    except Exception as error:  # what no command may let through
        return "traceback", f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    return "same", ""
