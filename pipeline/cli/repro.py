"""`yearloc repro` runs DVC and counts its stages; `yearloc repair` repairs its files after a kill.

DVC prints a line when it begins a stage. `Counting` puts before this line the stage's number, the
number of all stages, and an estimate of the time left.
"""

import os
import re
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from shutil import which
from typing import Any

import yaml

from pipeline.cli.project import conf_folder
from pipeline.core.errors import NotInstalledError
from pipeline.running.process import end_all
from pipeline.running.texts import WRITTEN, check_files, read_yaml

STAGE_LINE = re.compile(
    r"(?P<running>Running s|S)tage '(?:[^':]+:)?(?P<stage>[^'@:]+)(?:@[^']*)?'"
    r"(?:| didn't change.*| is cached.*)[:,]?"
)
"""Matches a line of DVC that says that it runs a stage, or skips the stage as up to date."""
HIDDEN_LINE = re.compile(
    r"Updating lock file|To track the changes|\tgit add|To enable auto|\tdvc config|"
    r"Use `dvc push`|WARNING: '.*' is empty"
)
"""Matches the beginnings of DVC's lines that are not shown."""
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
"""Seconds that an instance of each stage took in `make demo` on 2 cores.

Only their ratios count. Without them, an estimate from quick stages would be far too short for
training, and an estimate made after training far too long.
"""
OTHER_S = 10.0
"""Seconds that an instance of a stage takes that is not in USUAL_S."""
USUAL_WEIGHT = 2
"""The usual time weighs as much as this many measured instances of the stage."""


def repro() -> None:
    """Run `dvc repro`, count its stages, and estimate the time left."""
    for name in WRITTEN:
        read_yaml(conf_folder() / name)
    counting = Counting(count_instances(Path()))
    # an unbuffered DVC prints each line when it begins a stage
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
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
                if line.strip() and not HIDDEN_LINE.match(line):
                    print(counting.line(line, time.monotonic()), end="", flush=True)
        except KeyboardInterrupt:  # the terminal interrupts DVC too
            dvc.wait()
            raise
        except SystemExit:  # a signal to this process alone: DVC and its stage would go on
            end_all(dvc)
            raise
    if dvc.returncode:
        check_files(conf_folder())  # explains a broken file of conf/ better than DVC does
        sys.exit(dvc.returncode)


def repair() -> None:
    """Repair DVC's own files after DVC was killed; `make demo` does it first."""
    from pipeline.running import at_work

    at_work.refuse_at_work(Path())
    for lock in at_work.repair(Path()):
        print(
            f"{lock}: was cut off when DVC was killed, and is empty now; finished stages come back "
            "from DVC's cache"
        )
    check_files(conf_folder())


def count_instances(root: Path) -> Counter[str]:
    """Count how many instances each stage of the project at `root` has.

    A stage has one instance, or one for each entry of the list in conf/lists.yaml that its
    `foreach` names. The result is empty if the lists are not written yet.
    """
    try:
        lists = yaml.safe_load((root / "conf/lists.yaml").read_text(encoding="utf-8"))["lists"]
        files = [
            yaml.safe_load(path.read_text(encoding="utf-8"))
            for path in (root / "dvc.yaml", *root.glob("dag/*/dvc.yaml"))
        ]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        return Counter()
    instances: Counter[str] = Counter()
    for file in files:
        for name, stage in file["stages"].items():
            foreach = str(stage.get("foreach", ""))
            foreach_list = re.fullmatch(r"\$\{lists\.(\w+)\}", foreach)
            instances[name] += len(lists.get(foreach_list[1], ())) if foreach_list else 1
    return instances


@dataclass
class Counting:
    """Numbers the stages in DVC's lines, and estimates the time left.

    If `instances` is empty, lines stay as they are.
    """

    instances: Counter[str]
    """How many instances each stage has."""
    counts: Counter[str] = field(default_factory=Counter)
    """How many instances of each stage DVC has run or skipped so far."""
    took_s: dict[str, list[float]] = field(default_factory=dict)
    """The seconds that each finished instance of a stage took, by stage."""
    running: tuple[str, float] | None = None
    """The stage that DVC runs now, and when it began, in seconds.

    None before the first stage, and after a skipped stage.
    """

    def line(self, line: str, time_s: float) -> str:
        """The text to print for a line of DVC that came at `time_s`."""
        match = STAGE_LINE.match(line)
        if not match or not self.instances:
            return line
        if self.running:
            stage_before, start_s = self.running
            self.took_s.setdefault(stage_before, []).append(time_s - start_s)
        stage = match["stage"]
        self.counts[stage] += 1
        is_skipped = match["running"] == "S"  # "Stage …", not "Running stage …"
        if is_skipped:
            self.running = None
            return line
        self.running = (stage, time_s)
        remaining_note = f", {self.remaining_text()}" if self.took_s else ""
        return f"[{self.counts.total()}/{self.instances.total()}{remaining_note}] {line}"

    def remaining_text(self) -> str:
        """About how long the remaining instances take, with the one that runs now.

        The pace is the time of the finished instances, divided by their usual time. A remaining
        instance is expected to take its usual time at this pace, corrected by the times of the
        same stage (`_expected_s`).
        """
        total_took_s = sum(map(sum, self.took_s.values()))
        total_usual_s = sum(_usual_s(stage) * len(times) for stage, times in self.took_s.items())
        pace = total_took_s / total_usual_s
        remaining_instances = {
            stage: max(number - self.counts[stage], 0) for stage, number in self.instances.items()
        }
        if self.running:
            stage, _ = self.running
            remaining_instances[stage] = remaining_instances.get(stage, 0) + 1
        seconds = sum(
            number * self._expected_s(stage, pace) for stage, number in remaining_instances.items()
        )
        if seconds > 90:
            return f"about {seconds / 60:.0f} min left"
        return f"about {seconds:.0f} s left"

    def _expected_s(self, stage: str, pace: float) -> float:
        """The mean of the stage's measured times and, USUAL_WEIGHT times, its usual one."""
        took_s = self.took_s.get(stage, [])
        usual_s = _usual_s(stage) * pace
        return (USUAL_WEIGHT * usual_s + sum(took_s)) / (USUAL_WEIGHT + len(took_s))


def _usual_s(stage: str) -> float:
    return USUAL_S.get(stage, OTHER_S)
