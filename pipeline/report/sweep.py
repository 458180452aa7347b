"""The report of a sweep: a row a job, the job that held-out blocks choose, and a figure."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.report.figures.style import save
from pipeline.report.figures.sweep import SweepJob, response
from pipeline.report.findings import Finding
from pipeline.report.render import anchor, sentence, template
from pipeline.report.section import Illustration, Section
from pipeline.report.table import Table, average, number, spread, table
from pipeline.sweeps.record import Record

SHOWN = {  # protocol and number: heading, digits after the point
    ("cells", "auc_top1"): ("AUC top-1 (cells)", 3),
    ("cells", "recall_at_1"): ("recall@1 (cells)", 3),
    ("distance", "recall_at_1"): ("recall@1 (distance)", 3),
    ("cells", "auroc"): ("AUROC (cells)", 3),
    ("cells", "median_error_m"): ("error [m] (cells)", 1),
}
ALSO_DRAWN = (("cells", "oracle"), ("distance", "oracle"))


def write(folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]) -> str:
    """Write sweep.md, sweep.txt and, if any job succeeded, sweep.svg into `folder`.

    Returns the text for a terminal. `usual_overrides` are not shown.
    """
    jobs = [_job(record, usual_overrides) for record in records]
    names = dict.fromkeys(name for job in jobs for name in job.values)
    swept = tuple(name for name in names if len({job.values.get(name) for job in jobs}) > 1)
    job_table = _table(jobs, swept)
    findings = _findings(jobs, swept)
    first = records[0]
    where = f"{'simulated ' * records[0].simulated}{records[0].dataset}"
    fixed = "".join(
        f", {name}={value}" for name, value in jobs[0].values.items() if name not in swept
    )
    head = f"{where}: {len(jobs)} job{'s' * (len(jobs) != 1)}{fixed}"
    text = "\n\n".join([head, job_table.text().rstrip(), *map(sentence, findings)]) + "\n"
    (folder / "sweep.txt").write_text(text, encoding="utf-8")
    illustrations = []
    if any(job.numbers for job in jobs):
        illustrations.append(
            Illustration(
                "sweep", save(response(jobs, swept), folder / "sweep.svg", first.simulated)
            )
        )
    words = {"where": where, "simulated": first.simulated}
    section = Section(
        anchor(first.dataset, "sweep"),
        "sweep",
        values=words,
        findings=findings,
        illustrations=illustrations,
        tables=[job_table],
    )
    (folder / "sweep.md").write_text(
        template("section.md.j2", section=section, simulated=first.simulated, folder=folder),
        encoding="utf-8",
    )
    return text


def _job(record: Record, usual_overrides: Mapping[str, str]) -> SweepJob:
    """The job of a record, without the usual overrides."""
    settings = {key: value for key, value in record.overrides.items() if key not in usual_overrides}
    numbers = {key: values for key in (*SHOWN, *ALSO_DRAWN) if (values := record.values(*key))}
    return SweepJob(record.number, settings, numbers, record.error, record.held_out_auc)


def _table(jobs: Sequence[SweepJob], swept: Sequence[str]) -> Table:
    """A row a job: means over the test sequences ± standard deviation; dashes for a failed job."""
    rows = []
    for job in jobs:
        cells = [spread(job.numbers.get(key, ()), digits) for key, (_, digits) in SHOWN.items()]
        held_out = (
            "failed"
            if job.error
            else number(np.nan if job.held_out_auc is None else job.held_out_auc, 3)
        )
        rows.append((str(job.number), *map(job.value, swept), *cells, held_out))
    return table(
        "sweep",
        ("job", *swept, *(heading for heading, _ in SHOWN.values()), "held-out AUC"),
        rows,
        words=1 + len(swept),
    )


def _findings(jobs: Sequence[SweepJob], swept: Sequence[str]) -> list[Finding]:
    """The failed jobs, and for each grid the job with the best held-out AUC and its scores.

    Grids are apart, since the held-out AUC is by cells.
    """
    findings = [
        Finding("sweep_failed", number=job.number, error=job.error) for job in jobs if job.error
    ]
    groups = dict[str, list[Any]]()
    grid = [name for name in swept if name.partition(".")[0] == "grid"]
    other_names = [name for name in swept if name not in grid]
    for job in jobs:
        if job.numbers and job.held_out_auc is not None:
            groups.setdefault(_settings(job, grid), []).append((job.held_out_auc, -job.number, job))
    for key, group in groups.items():
        held_out, _, job = max(group, key=lambda entry: entry[:2])
        auc, recall = (
            average(job.numbers.get(protocol_number, ()))
            for protocol_number in (("cells", "auc_top1"), ("distance", "recall_at_1"))
        )
        context = {
            "grid": key,
            "settings": _settings(job, other_names),
            "held_out": held_out,
            "auc": auc,
            "recall": recall,
        }
        findings.append(Finding("sweep_choice", number=job.number, **context))
    return findings


def _settings(job: SweepJob, names: Sequence[str]) -> str:
    return ", ".join(f"{name}={job.value(name)}" for name in names)
