"""The report of a sweep: a row a job, the job that held-out blocks choose, and a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.report.figures.style import save
from pipeline.report.figures.sweep import response, setting
from pipeline.report.findings import Finding
from pipeline.report.render import sentence, template
from pipeline.report.section import Illustration, Section, anchor
from pipeline.report.table import Table, average, number, spread, table
from pipeline.sweeps.record import Record

SHOWN = {  # protocol and number: heading, digits after the point
    ("cells", "auc_top1"): ("AUC top-1 (cells)", 3),
    ("cells", "recall_at_1"): ("recall@1 (cells)", 3),
    ("distance", "recall_at_1"): ("recall@1 (distance)", 3),
    ("cells", "auroc"): ("AUROC (cells)", 3),
    ("cells", "median_error_m"): ("error [m] (cells)", 1),
}


def write(folder: Path, records: Sequence[Record], usual_overrides: Mapping[str, str]) -> str:
    """Write sweep.md, sweep.txt and, if any job succeeded, sweep.svg into `folder`.

    Returns the text for a terminal. `usual_overrides` are not shown.
    """
    jobs = [
        replace(
            record,
            overrides={k: v for k, v in record.overrides.items() if k not in usual_overrides},
        )
        for record in records
    ]
    first = jobs[0]
    names = dict.fromkeys(name for job in jobs for name in job.overrides)
    swept = [name for name in names if len({job.overrides.get(name) for job in jobs}) > 1]
    fixed = [f", {name}={value}" for name, value in first.overrides.items() if name not in swept]
    where = f"{'simulated ' * first.simulated}{first.dataset}"
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
    head = f"{where}: {len(jobs)} job{'s' * (len(jobs) != 1)}{''.join(fixed)}"
    parts = [head, section.tables[0].text().rstrip(), *map(sentence, section.findings)]
    text = "\n\n".join(parts) + "\n"
    (folder / "sweep.txt").write_text(text, encoding="utf-8")
    return text


def _table(jobs: Sequence[Record], swept: Sequence[str]) -> Table:
    """A row a job: means over the test sequences ± standard deviation; dashes for a failed job."""
    rows = [
        (
            str(job.number),
            *(setting(job, name) for name in swept),
            *(spread(job.values(*key), digits) for key, (_, digits) in SHOWN.items()),
            "failed"
            if job.error
            else number(np.nan if job.held_out_auc is None else job.held_out_auc, 3),
        )
        for job in jobs
    ]
    header = ("job", *swept, *(heading for heading, _ in SHOWN.values()), "held-out AUC")
    return table("sweep", header, rows, words=1 + len(swept))


def _findings(jobs: Sequence[Record], swept: Sequence[str]) -> list[Finding]:
    """The failed jobs, and for each grid the job with the best held-out AUC and its scores.

    Grids are apart, since the held-out AUC is by cells.
    """
    grid = [name for name in swept if name.partition(".")[0] == "grid"]
    others = [name for name in swept if name not in grid]
    best: dict[str, tuple[float, Record]] = {}  # of each grid
    for job in jobs:
        held_out = job.held_out_auc
        key = _settings(job, grid)
        if held_out is not None and (key not in best or held_out > best[key][0]):
            best[key] = held_out, job
    failed = [
        Finding("sweep_failed", number=job.number, error=job.error) for job in jobs if job.error
    ]
    chosen = [
        Finding(
            "sweep_choice",
            number=job.number,
            grid=key,
            settings=_settings(job, others),
            held_out=held_out,
            auc=average(job.values("cells", "auc_top1")),
            recall=average(job.values("distance", "recall_at_1")),
        )
        for key, (held_out, job) in best.items()
    ]
    return failed + chosen


def _settings(job: Record, names: Sequence[str]) -> str:
    return ", ".join(f"{name}={setting(job, name)}" for name in names)
