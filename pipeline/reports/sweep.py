"""A sweep at a glance: one row a job, which job to choose, and how the numbers move with what was swept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.reports import response
from pipeline.reports.style import save
from pipeline.reports.table import MISSING, Table, mean, number, present, spread

SHOWN = (
    ("AUC top-1 (cells)", "cells", "auc_top1", 3),
    ("recall@1 (cells)", "cells", "recall_at_1", 3),
    ("recall@1 (distance)", "distance", "recall_at_1", 3),
    ("AUROC (cells)", "cells", "auroc", 3),
    ("error [m] (cells)", "cells", "median_error_m", 1),
)
"""Heading, protocol, key in metrics.json, digits after the point."""
CAPTION = """\
Each faint dot is one test sequence, a line joins their means, a cross is a job that failed; the grey line is the oracle's
recall@1, a share of the seen queries and no AUC. By cells, cells of another side mean other places and other seen queries, on the
test sequences and on the held-out blocks alike: compare numbers by cells, held-out AUC included, within one grid only, and
across grids by distance. Choose by the held-out AUC, which no test sequence enters: the best of many jobs on the test sequences
is partly luck.
"""


@dataclass(frozen=True)
class Job:
    """What one job of a sweep was told, and what came of it."""

    number: int
    overrides: Mapping[str, str]
    """Such as {"grid.cell_m": "5", "method.n_way": "2"}."""
    numbers: Mapping[str, Mapping[str, Any]] | None
    """Test sequence to its metrics.json; None if the job failed."""
    held_out_auc: float | None = None
    """By cells, on the held-out blocks of training."""
    error: str | None = None
    """Why it failed, in one line."""

    def told(self, name: str) -> str:
        """The value of a parameter."""
        return self.overrides.get(name, MISSING)

    def values(self, protocol: str, name: str) -> list[float]:
        """One number of each test sequence that has it; none of a failed job."""
        return present([numbers[protocol][name] for numbers in (self.numbers or {}).values()])


@dataclass(frozen=True)
class Sweep:
    """All jobs of a sweep over one data set."""

    jobs: Sequence[Job]
    dataset: str
    simulated: bool

    def swept(self) -> tuple[str, ...]:
        """The parameters that differ among the jobs, in the order they were given."""
        names = dict.fromkeys(name for job in self.jobs for name in job.overrides)
        return tuple(name for name in names if len({job.told(name) for job in self.jobs}) > 1)

    def fixed(self) -> dict[str, str]:
        """What all jobs were told alike."""
        first = self.jobs[0].overrides if self.jobs else {}
        return {name: value for name, value in first.items() if name not in self.swept()}

    def table(self) -> Table:
        """A row a job: means over the test sequences ± standard deviation; dashes for a job that failed."""
        rows = []
        for job in self._ordered():
            found = [spread(job.values(protocol, name), digits) for _, protocol, name, digits in SHOWN]
            held_out = number(mean([job.held_out_auc]), 3) if job.error is None else "failed"
            rows.append((str(job.number), *map(job.told, self.swept()), *found, held_out))
        header = ("job", *self.swept(), *(heading for heading, *_ in SHOWN), "held-out AUC")
        return Table(header, tuple(rows), words=1 + len(self.swept()))

    def failures(self) -> list[str]:
        """A line for each job that failed."""
        return [f"job {job.number} failed: {job.error}" for job in self._ordered() if job.error is not None]

    def findings(self) -> list[str]:
        """Which job the held-out blocks choose, and how it fared; one for each grid, since their AUC is by cells."""
        grid = [name for name in self.swept() if name.partition(".")[0] == "grid"]
        groups: dict[str, list[Job]] = {}
        for job in self._ordered():
            if job.numbers and present([job.held_out_auc]):
                groups.setdefault(", ".join(f"{name}={job.told(name)}" for name in grid), []).append(job)
        return [_choice(which, group, [name for name in self.swept() if name not in grid]) for which, group in groups.items()]

    def text(self) -> str:
        """The table for a terminal."""
        made = f"simulated {self.dataset}" if self.simulated else self.dataset
        fixed = "".join(f", {name}={value}" for name, value in self.fixed().items())
        count = max((len(job.numbers or {}) for job in self.jobs), default=0)
        jobs = "1 job" if len(self.jobs) == 1 else f"{len(self.jobs)} jobs"
        head = f"{made}: {jobs}{fixed}; means over {count} test sequences ± standard deviation"
        parts = (head, self.table().text().rstrip(), "\n".join(self.failures()), "\n".join(self.findings()))
        return "\n\n".join(filter(None, parts)) + "\n"

    def write(self, folder: Path) -> None:
        """Write sweep.md, sweep.txt and, if any job went well, sweep.svg into `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sweep.txt").write_text(self.text())
        drawn = any(job.numbers for job in self.jobs)
        if drawn:
            save(response.draw(self.jobs, self.swept(), self.simulated), folder / "sweep.svg")
        parts = (
            f"# A sweep on {self.dataset}\n",
            "**Simulated, not recorded data.**\n" if self.simulated else "",
            "".join(f"- all jobs: {name}={value}\n" for name, value in self.fixed().items()),
            self.table().markdown(),
            "Means over the test sequences ± standard deviation; held-out AUC: by cells, on held-out blocks of training.\n",
            "".join(f"- {line}\n" for line in self.failures() + self.findings()),
            f"![The sweep](sweep.svg)\n\n{CAPTION}" if drawn else "",
        )
        (folder / "sweep.md").write_text("\n".join(filter(None, parts)))

    def _ordered(self) -> list[Job]:
        return sorted(self.jobs, key=lambda job: job.number)


def _choice(which: str, jobs: Sequence[Job], names: Sequence[str]) -> str:
    """The sentence on the job of highest held-out AUC; of equals, the first."""
    best = max(jobs, key=lambda job: present([job.held_out_auc])[0])
    told = ", ".join(f"{name}={best.told(name)}" for name in names)
    return (
        f"Held-out blocks choose job {best.number}"
        + (f" of {which}" if which else "")
        + (f": {told}" if told else "")
        + f" (held-out AUC {number(best.held_out_auc, 3)}); on the test sequences it had AUC top-1"
        f" {number(mean(best.values('cells', 'auc_top1')), 3)} by cells and recall@1"
        f" {number(mean(best.values('distance', 'recall_at_1')), 3)} by distance."
    )
