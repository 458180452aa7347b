"""`yearloc repro`: `dvc repro` that counts its stages and says how long the rest may take."""

import argparse
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
from statistics import fmean
from typing import Any

import yaml

from pipeline.cli.project import conf_folder
from pipeline.errors import NotInstalledError
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
"""Lines of DVC's that nobody needs who did not ask for them."""


def add_command(commands: Any) -> None:
    """It takes nothing."""
    commands.add_parser(
        "repro", help="`dvc repro` that counts its stages and says how long the rest may take"
    )


def repro(given: argparse.Namespace) -> None:
    """Run `dvc repro` and show its lines, each stage's with its number; its exit code is ours."""
    for name in WRITTEN:
        read_yaml(conf_folder() / name)
    counting = Counting(count_instances(Path()))
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}  # else lines come when a buffer is full
    if not which("dvc"):
        raise NotInstalledError(
            "dvc: not found; `source .venv/bin/activate` first, or `pip install 'yearloc[chain]'`"
        )
    how: dict[str, Any] = {
        "stdout": subprocess.PIPE,
        "encoding": "utf-8",
        "errors": "replace",
        "env": environment,
    }
    with subprocess.Popen(["dvc", "repro"], **how) as dvc:
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


def count_instances(root: Path) -> Counter[str]:
    """How many instances each stage of the project at `root` has; none where its lists are not
    written yet."""
    try:
        lists = yaml.safe_load((root / "conf/lists.yaml").read_text(encoding="utf-8"))["lists"]
        files = [
            yaml.safe_load(path.read_text(encoding="utf-8"))
            for path in (root / "dvc.yaml", *root.glob("dag/*/dvc.yaml"))
        ]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        return Counter()
    stages: Iterable[tuple[str, Mapping[str, Any]]] = (
        one for file in files for one in file["stages"].items()
    )
    instances: Counter[str] = Counter()
    for name, stage in stages:
        found = re.fullmatch(r"\$\{lists\.(\w+)\}", str(stage.get("foreach", "")))
        instances[name] += len(lists.get(found[1], ())) if found else 1
    return instances


@dataclass
class Counting:
    """Numbers the stages that DVC tells of, out of how many instances each has; without these it
    leaves lines as they are."""

    instances: Counter[str]
    met: Counter[str] = field(default_factory=Counter)
    took_s: dict[str, list[float]] = field(default_factory=dict)
    now: tuple[str, float] | None = None  # the stage under way, and when it began

    def line(self, line: str, time_s: float) -> str:
        """A line of DVC's as it is shown, given the time at which it came."""
        if not (found := STAGE.match(line)) or not self.instances:
            return line
        if self.now:
            self.took_s.setdefault(self.now[0], []).append(time_s - self.now[1])
        stage = found["stage"]
        running = found["running"] != "S"
        self.now = (stage, time_s) if running else None
        self.met[stage] += 1
        left = f", {self.left()}" if running and self.took_s else ""
        return f"[{self.met.total()}/{self.instances.total()}{left}] {line}" if running else line

    def left(self) -> str:
        """About how long the rest takes, as long as the stages of its kind took so far; of kinds
        not met yet, as all did."""
        usual = fmean(one for took in self.took_s.values() for one in took)
        rest = {stage: max(number - self.met[stage], 0) for stage, number in self.instances.items()}
        if self.now:
            rest[self.now[0]] = rest.get(self.now[0], 0) + 1
        seconds = sum(
            number * fmean(self.took_s.get(stage, [usual])) for stage, number in rest.items()
        )
        return (
            f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"
        )
