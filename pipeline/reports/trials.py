"""A sweep as the runs that MLflow shows: one parent, and a child a job with its metrics over the days since training."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.reports.sweep import Job, Sweep
from pipeline.reports.table import mean, present
from pipeline.tracking.runs import RunRecord

CHARTED = (("cells", "auc_top1"), ("cells", "recall_at_1"), ("distance", "recall_at_1"))
"""What the parent charts of each job: protocol and number, as the mean over the test sequences."""


def record(sweep: Sweep, method: str, figures: Sequence[Path]) -> RunRecord:
    """The runs of one sweep, named by what was swept; the steps of the parent's own metrics are the jobs' numbers."""
    values = {name: ",".join(dict.fromkeys(job.told(name) for job in sweep.jobs)) for name in sweep.swept()} | sweep.fixed()
    tags = {"dataset": sweep.dataset, "method": method, "data": "simulated" if sweep.simulated else "recorded"}
    means = {
        f"sweep/{protocol}_{name}": [(job.number, mean(job.values(protocol, name))) for job in sweep.jobs]
        for protocol, name in CHARTED
    }
    means["sweep/held_out_auc"] = [(job.number, job.held_out_auc) for job in sweep.jobs]
    series = {name: [(step, one) for step, value in points for one in present([value])] for name, points in means.items()}
    children = [
        RunRecord(
            _short(job.overrides) or f"job {job.number}",
            tags | ({"error": job.error} if job.error else {}),
            job.overrides,
            _over_days(job),
        )
        for job in sweep.jobs
    ]
    return RunRecord(f"sweep {_short(values)}"[:240], tags, values, {k: v for k, v in series.items() if v}, figures, children)


def _short(values: Mapping[str, str]) -> str:
    return " ".join(f"{name.rpartition('.')[2]}={value}" for name, value in values.items())


def _over_days(job: Job) -> dict[str, list[tuple[int, float]]]:
    """Every number of a job that there is, under the names that a study's runs have."""
    series: dict[str, list[tuple[int, float]]] = {}
    for numbers in (job.numbers or {}).values():
        for group in ("cells", "distance", "calibration"):
            for name, value in numbers[group].items():
                for number in present([value]):
                    series.setdefault(f"{group}/{name}", []).append((int(numbers["days"]), number))
    return series
