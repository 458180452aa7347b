"""The report of a sweep: a table of its jobs, the job that validation blocks choose, and a figure.

In: the records of the jobs, each with its settings and its rows of numbers. Out: sweep.md,
sweep.svg and a text for a terminal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.evaluation.numbers import average
from pipeline.report.figures.style import save
from pipeline.report.figures.sweep import response, setting
from pipeline.report.findings import Finding
from pipeline.report.render import sentence, template
from pipeline.report.section import Illustration, Section, anchor
from pipeline.report.table import Table, number, spread, table
from pipeline.sweeps.record import Record

# The columns of the table: protocol and number to heading and digits after the point.
SHOWN = {
    ("cells", "auc_top1"): ("AUC top-1 (cells)", 3),
    ("cells", "recall_at_1"): ("recall@1 (cells)", 3),
    ("distance", "recall_at_1"): ("recall@1 (distance)", 3),
    ("cells", "auroc"): ("AUROC (cells)", 3),
    ("cells", "median_error_m"): ("error [m] (cells)", 1),
}


def write(folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]) -> str:
    """Write sweep.md, sweep.txt and, if any job succeeded, sweep.svg into `folder`.

    Returns the text for a terminal. Settings named in `usual_overrides` are not shown.
    """
    jobs = []
    for record in records:
        shown = {k: v for k, v in record.overrides.items() if k not in usual_overrides}
        jobs.append(replace(record, overrides=shown))
    first = jobs[0]
    names = dict.fromkeys(name for job in jobs for name in job.overrides)
    swept = [name for name in names if len({job.overrides.get(name) for job in jobs}) > 1]
    fixed = [f", {name}={value}" for name, value in first.overrides.items() if name not in swept]
    where = f"simulated {first.dataset}" if first.simulated else first.dataset
    illustrations = []
    if any(job.rows for job in jobs):
        path = save(response(jobs, swept), folder / "sweep.svg", first.simulated)
        illustrations.append(Illustration("sweep", path))
    section = Section(
        anchor(first.dataset, "sweep"),
        "sweep",
        values={"where": where, "simulated": first.simulated},
        findings=_findings(jobs, swept),
        illustrations=illustrations,
        tables=[_table(jobs, swept)],
    )
    (folder / "sweep.md").write_text(
        template("section.md.j2", section=section, simulated=first.simulated, folder=folder),
        encoding="utf-8",
    )
    job_count = "1 job" if len(jobs) == 1 else f"{len(jobs)} jobs"
    parts = [
        f"{where}: {job_count}{''.join(fixed)}",
        section.tables[0].text().rstrip(),
        *map(sentence, section.findings),
    ]
    text = "\n\n".join(parts) + "\n"
    (folder / "sweep.txt").write_text(text, encoding="utf-8")
    return text


def _table(jobs: Sequence[Record], swept: Sequence[str]) -> Table:
    """One row per job: means ± standard deviation over the test sequences; dashes if it failed."""
    rows = []
    for job in jobs:
        settings = [setting(job, name) for name in swept]
        means = [spread(job.values(*key), digits) for key, (_, digits) in SHOWN.items()]
        validation_auc = np.nan if job.validation_auc is None else job.validation_auc
        outcome = "failed" if job.error else number(validation_auc, 3)
        rows.append((str(job.number), *settings, *means, outcome))
    header = ("job", *swept, *(heading for heading, _ in SHOWN.values()), "validation AUC")
    return table("sweep", header, rows, text_columns=1 + len(swept))


def _findings(jobs: Sequence[Record], swept: Sequence[str]) -> list[Finding]:
    """The failed jobs, and for each cell size the job with the best validation AUC and its scores.

    The validation AUC is by cells, so values of different cell sizes cannot be compared.
    """
    grid_settings = [name for name in swept if name.partition(".")[0] == "grid"]
    other_settings = [name for name in swept if name not in grid_settings]
    best: dict[str, Record] = {}  # grid to job
    for job in jobs:
        grid = _settings(job, grid_settings)
        if job.validation_auc is not None and (
            grid not in best or job.validation_auc > (best[grid].validation_auc or 0.0)
        ):
            best[grid] = job
    failed = [
        Finding("sweep_failed", number=job.number, error=job.error) for job in jobs if job.error
    ]
    chosen = [
        Finding(
            "sweep_choice",
            number=job.number,
            grid=grid,
            settings=_settings(job, other_settings),
            validation=job.validation_auc,
            auc=average(job.values("cells", "auc_top1")),
            recall=average(job.values("distance", "recall_at_1")),
        )
        for grid, job in best.items()
    ]
    return failed + chosen


def _settings(job: Record, names: Sequence[str]) -> str:
    """Some settings of a job as words: `grid.cell_m=5, grid.x=1`."""
    return ", ".join(f"{name}={setting(job, name)}" for name in names)
