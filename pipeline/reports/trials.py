"""A sweep as the runs that MLflow shows: one parent, and a child a job with its metrics over the days since training."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.reports.style import colour
from pipeline.reports.sweep import Job, Sweep
from pipeline.reports.tables import present
from pipeline.tracking import RunRecord

PARENT = (("cells", "auc_top1"), ("cells", "recall_at_1"), ("distance", "recall_at_1"))
"""What the parent charts of each job: protocol and number, as the mean over the test sequences; steps are the jobs' numbers."""


def record(sweep: Sweep, method: str, figures: Sequence[Path]) -> RunRecord:
    """The runs of one sweep, named by what was swept."""
    swept = {name: ",".join(dict.fromkeys(job.told(name) for job in sweep.jobs)) for name in sweep.swept()}
    name = " ".join(f"{key}={values}" for key, values in (swept | sweep.fixed()).items())
    tags = {
        "mlflow.runColor": colour(method),
        "dataset": sweep.dataset,
        "method": method,
        "data": "simulated" if sweep.simulated else "recorded",
    }
    series = {
        f"sweep/{protocol}_{number}": [(job.number, value) for job in sweep.jobs for value in _mean(job, protocol, number)]
        for protocol, number in PARENT
    }
    series["sweep/held_out_auc"] = [(job.number, value) for job in sweep.jobs for value in present([job.held_out_auc])]
    children = [
        RunRecord(
            f"job {job.number}: " + " ".join(f"{key}={value}" for key, value in job.overrides.items()),
            tags | ({"error": job.error} if job.error else {}),
            job.overrides,
            _over_days(job),
        )
        for job in sweep.jobs
    ]
    return RunRecord(
        f"sweep {name}"[:240], tags, swept | sweep.fixed(), {k: v for k, v in series.items() if v}, figures, children
    )


def _mean(job: Job, protocol: str, number: str) -> list[float]:
    values = job.values(protocol, number)
    return [sum(values) / len(values)] if values else []


def _over_days(job: Job) -> dict[str, list[tuple[int, float]]]:
    """Every number of a job that there is, under the names that a study's runs have."""
    series: dict[str, list[tuple[int, float]]] = {}
    for numbers in (job.numbers or {}).values():
        for group in ("cells", "distance", "calibration"):
            for name, value in numbers[group].items():
                for number in present([value]):
                    series.setdefault(f"{group}/{name}", []).append((int(numbers["days"]), number))
    return series
