"""`yearloc repro` and `yearloc repair`: DVC's stages counted, and its files put right."""

import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shutil import which
from typing import Any

import yaml

from pipeline.cli.project import conf_folder
from pipeline.core.errors import NotInstalledError
from pipeline.running.ending import end_all
from pipeline.running.texts import WRITTEN, check_files, read_yaml

STAGE = re.compile(
    r"(?P<running>Running s|S)tage '(?:[^':]+:)?(?P<stage>[^'@:]+)(?:@[^']*)?'"
    r"(?:| didn't change.*| is cached.*)[:,]?"
)
ASIDE = re.compile(
    r"Updating lock file|To track the changes|\tgit add|To enable auto|\tdvc config|"
    r"Use `dvc push`|WARNING: '.*' is empty"
)
"""Lines of DVC that are not shown."""
USUAL_S = {
    "logs": 9.0,
    "scans": 4.0,
    "submaps": 4.0,
    "labels": 4.0,
    "views": 9.0,
    "map": 5.0,
    "train": 45.0,
    "localize": 8.0,
    "poses": 115.0,
    "evaluate": 6.0,
    "results": 6.0,
    "report": 18.0,
    "publish": 10.0,
}
"""Seconds that a stage of each kind took in `make demo` on 2 cores; only their shares count.

Without them a guess from quick stages falls short of training, and one after training is far off.
"""
OTHER_S = 10.0
AS_USUAL = 2
"""So many stages of a kind are taken to be as usual, beside those that were measured."""


def repro() -> None:
    """`dvc repro` that counts its stages and says how long the rest may take."""
    for name in WRITTEN:
        read_yaml(conf_folder() / name)
    counting = Counting(count_instances(Path()))
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}  # else lines come when a buffer is full
    if not which("dvc"):
        raise NotInstalledError(
            "dvc: not found; `source .venv/bin/activate` first, or `pip install 'yearloc[chain]'`"
        )
    process_options: dict[str, Any] = {
        "stdout": subprocess.PIPE,
        "encoding": "utf-8",
        "errors": "replace",
        "env": environment,
    }
    with subprocess.Popen(["dvc", "repro"], **process_options) as dvc:
        try:
            for line in dvc.stdout or ():
                if line.strip() and not ASIDE.match(line):
                    print(counting.line(line, time.monotonic()), end="", flush=True)
        except KeyboardInterrupt:  # the terminal has told DVC too
            dvc.wait()
            raise
        except (
            SystemExit
        ):  # nobody has told it, nor the stage under way, which the next repro would run beside
            end_all(dvc)
            raise
    if dvc.returncode:
        check_files(conf_folder())  # of which DVC says less
        sys.exit(dvc.returncode)


def repair() -> None:
    """Put right what a kill may leave of DVC's own files; `make demo` does it first."""
    from pipeline.running import repair as files
    from pipeline.running.at_work import refuse_at_work

    refuse_at_work(Path())
    for lock in files.repair(Path()):
        print(
            f"{lock}: was torn by a kill and is empty now; what is finished comes back from DVC's "
            "cache"
        )
    check_files(conf_folder())


def count_instances(root: Path) -> Counter[str]:
    """Count the instances of each stage of the project at `root`.

    Empty where the project's lists are not written yet.
    """
    try:
        lists = yaml.safe_load((root / "conf/lists.yaml").read_text(encoding="utf-8"))["lists"]
        files = [
            yaml.safe_load(path.read_text(encoding="utf-8"))
            for path in (root / "dvc.yaml", *root.glob("dag/*/dvc.yaml"))
        ]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        return Counter()
    stages: Iterable[tuple[str, Mapping[str, Any]]] = (
        named_stage for file in files for named_stage in file["stages"].items()
    )
    instances: Counter[str] = Counter()
    for name, stage in stages:
        foreach_list = re.fullmatch(r"\$\{lists\.(\w+)\}", str(stage.get("foreach", "")))
        instances[name] += len(lists.get(foreach_list[1], ())) if foreach_list else 1
    return instances


@dataclass
class Counting:
    """Numbers the stages in DVC's lines, and estimates the time left.

    Without `instances` it leaves lines as they are.
    """

    instances: Counter[str]
    met: Counter[str] = field(default_factory=Counter)
    took_s: dict[str, list[float]] = field(default_factory=dict)
    now: tuple[str, float] | None = None
    """The stage under way, and when it began."""

    def line(self, line: str, time_s: float) -> str:
        """The text to print for a line of DVC that came at `time_s`."""
        if not (match := STAGE.match(line)) or not self.instances:
            return line
        if self.now:
            self.took_s.setdefault(self.now[0], []).append(time_s - self.now[1])
        stage = match["stage"]
        running = match["running"] != "S"
        self.now = (stage, time_s) if running else None
        self.met[stage] += 1
        remaining = f", {self.remaining_text()}" if running and self.took_s else ""
        return (
            f"[{self.met.total()}/{self.instances.total()}{remaining}] {line}" if running else line
        )

    def remaining_text(self) -> str:
        """About how long the remaining stages take.

        Kinds of stages share the pace at which those that ran took USUAL_S; what the stages of a
        kind took counts the more the more of them there were.
        """
        took_s = sum(map(sum, self.took_s.values()))
        usual_s = sum(_usual_s(stage) * len(times_s) for stage, times_s in self.took_s.items())
        remaining = {
            stage: max(number - self.met[stage], 0) for stage, number in self.instances.items()
        }
        if self.now:
            remaining[self.now[0]] = remaining.get(self.now[0], 0) + 1
        seconds = sum(
            number * self._expected_s(stage, took_s / usual_s)
            for stage, number in remaining.items()
        )
        return (
            f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"
        )

    def _expected_s(self, stage: str, pace: float) -> float:
        """The mean of what stages of this kind took, and of some that took as long as usual."""
        took_s = self.took_s.get(stage, [])
        return (AS_USUAL * _usual_s(stage) * pace + sum(took_s)) / (AS_USUAL + len(took_s))


def _usual_s(stage: str) -> float:
    return USUAL_S.get(stage, OTHER_S)
