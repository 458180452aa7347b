"""Runs a sweep of settings in a copy of the project, for the tests of sweeps."""

import json
import subprocess
from typing import Any

from tests.clone import BIN, Clone


class Swept:
    """One sweep that was run: its exit code, output and records."""

    def __init__(self, clone: Clone, *overrides: str) -> None:
        command = [str(BIN / "python"), "-m", "stages.sweep", "-m", *overrides]
        done = subprocess.run(
            command, cwd=clone.folder, env=clone.env, capture_output=True, text=True
        )
        self.code = done.returncode
        self.out = done.stdout
        self.err = done.stderr
        (line,) = [line for line in done.stdout.splitlines() if line.startswith("sweep: ")] or [""]
        assert line, f"{overrides}\n{done.stdout}\n{done.stderr}"
        self.folder = clone.folder / line.rpartition(" ")[2]
        self.jobs: list[dict[str, Any]] = [
            json.loads((self.folder / f"{number}.json").read_text())
            for number in range(len(list(self.folder.glob("*.json"))))
        ]

    @property
    def built(self) -> set[str]:
        """The stages of which some job built an artifact."""
        return {stage for job in self.jobs for stage in job["built"]}

    def value(self, job: int, name: str = "auc_top1") -> list[float]:
        """The values of a number by cells in a job, one a test sequence."""
        wanted = [
            row
            for row in self.jobs[job]["rows"]
            if (row["protocol"], row["number"]) == ("cells", name)
        ]
        return [row["value"] for row in wanted if row.get("ask") != "novelty"]


def outcome(swept: Swept) -> list[Any]:
    """The overrides, rows and error of each job; rows are text, since no NaN equals another."""
    return [(job["overrides"], str(job["rows"]), job["error"]) for job in swept.jobs]
