"""A sweep at a glance: a row a job, which job held-out blocks choose, and how the numbers move with what was swept."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.report.figures.style import save
from pipeline.report.figures.sweep import SweepJob, response
from pipeline.report.findings import Finding
from pipeline.report.render import anchor, sentence, template
from pipeline.report.section import Illustration, Section
from pipeline.report.table import MISSING, Cell, Table, number, spread, word
from pipeline.sweeps.record import Record

SHOWN = (
    ("AUC top-1 (cells)", "cells", "auc_top1", 3),
    ("recall@1 (cells)", "cells", "recall_at_1", 3),
    ("recall@1 (distance)", "distance", "recall_at_1", 3),
    ("AUROC (cells)", "cells", "auroc", 3),
    ("error [m] (cells)", "cells", "median_error_m", 1),
)
"""Heading, protocol, number, digits after the point."""
ALSO_DRAWN = (("cells", "oracle"), ("distance", "oracle"))


def write(folder: Path, records: Sequence[Record], usual: Mapping[str, str]) -> str:
    """Write sweep.md, sweep.txt and, if any job went well, sweep.svg into `folder`; returns the text for a terminal."""
    own = {one.number: {key: value for key, value in one.overrides.items() if key not in usual} for one in records}
    names = dict.fromkeys(name for overrides in own.values() for name in overrides)
    swept = tuple(name for name in names if len({overrides.get(name) for overrides in own.values()}) > 1)
    jobs = [SweepJob(one.number, own[one.number], values(one), one.error) for one in records]
    listed, found = _table(records, jobs, swept), _findings(records, jobs, swept)
    first, fixed = records[0], {name: value for name, value in own[records[0].number].items() if name not in swept}
    where = f"{'simulated ' * first.simulated}{first.dataset}"
    head = f"{where}: {len(jobs)} job{'s' * (len(jobs) != 1)}{''.join(f', {name}={value}' for name, value in fixed.items())}"
    text = "\n\n".join([head, listed.text().rstrip(), *map(sentence, found)]) + "\n"
    (folder / "sweep.txt").write_text(text)
    drawn: tuple[Illustration, ...] = ()
    if any(job.numbers for job in jobs):
        drawn = (Illustration("sweep", save(response(jobs, swept, first.simulated), folder / "sweep.svg"), {}),)
    section = Section(anchor(first.dataset, "sweep"), "sweep", "studies", {"where": where}, tuple(found), drawn, (listed,))
    (folder / "sweep.md").write_text(template("section.md.j2", section=section, simulated=first.simulated, folder=folder))
    return text


def values(record: Record) -> dict[tuple[str, str], list[float]]:
    """Protocol and number to one value a test sequence, those that are there; none of a failed job."""
    keys = [(protocol, name) for _, protocol, name, _ in SHOWN] + [*ALSO_DRAWN]
    every = (record.numbers or {}).values()
    found = {key: [float(one[key[0]][key[1]]) for one in every if one[key[0]][key[1]] is not None] for key in keys}
    return {key: value for key, value in found.items() if value}


def _table(records: Sequence[Record], jobs: Sequence[SweepJob], swept: Sequence[str]) -> Table:
    """A row a job: means over the test sequences ± standard deviation; dashes for a job that failed."""
    rows = []
    for record, job in zip(records, jobs, strict=True):
        cells = [spread(job.numbers.get((protocol, name), []), digits) for _, protocol, name, digits in SHOWN]
        held_out = Cell("failed") if record.error else number(_or_nan(record.held_out_auc), 3)
        rows.append((word(job.number), *(word(job.values.get(name, MISSING)) for name in swept), *cells, held_out))
    header = ("job", *swept, *(heading for heading, *_ in SHOWN), "held-out AUC")
    return Table("sweep", header, tuple(rows), words=1 + len(swept))


def _findings(records: Sequence[Record], jobs: Sequence[SweepJob], swept: Sequence[str]) -> list[Finding]:
    """Failures, and for each grid, since the held-out AUC is by cells, which job it chooses and how that job fared."""
    found = [Finding("sweep_failed", {"number": one.number, "error": one.error}) for one in records if one.error]
    grid, groups = [name for name in swept if name.partition(".")[0] == "grid"], dict[str, list[tuple[float, SweepJob]]]()
    for record, job in zip(records, jobs, strict=True):
        if job.numbers and record.held_out_auc is not None:
            key = ", ".join(f"{name}={job.values.get(name, MISSING)}" for name in grid)
            groups.setdefault(key, []).append((record.held_out_auc, job))
    for key, group in groups.items():
        held_out, job = max(group, key=lambda one: (one[0], -one[1].number))
        settings = ", ".join(f"{name}={job.values.get(name, MISSING)}" for name in swept if name not in grid)
        means = [spread(job.numbers.get(one, []), 3).key for one in (("cells", "auc_top1"), ("distance", "recall_at_1"))]
        shown = {"number": job.number, "grid": key, "settings": settings, "held_out": held_out}
        found.append(Finding("sweep_choice", shown | dict(zip(("auc", "recall"), map(_or_nan, means), strict=True))))
    return found


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
