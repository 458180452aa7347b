"""Sweeps settings: runs the chain for every combination of values; ends with a table and a figure.

    python -m stages.sweep -m grid.cell_m=5,10,20 method.n_way=1,2,4

Each combination is a job (`stages.sweep.job`). Hydra's multirun starts the jobs, here or on a
cluster. An artifact that several jobs need is built once.
"""

import os
import sys
import time
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from pipeline.core.errors import ConfigError, YearlocError
from pipeline.running.texts import check_files
from pipeline.studies.studies_file import read_listed_studies
from pipeline.sweeps.record import Record, cost, read
from pipeline.tracking import records
from pipeline.tracking.runs import experiment_of, publish
from stages import ROOT, reported
from stages.report import sweep_report
from stages.sweep.job import CORRECTABLE, SWEEPS, job


def main() -> None:
    """Run the jobs, wherever Hydra's launcher starts them, and report on them."""
    folder = SWEEPS / "runs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    job_words, tracking_words = split_tracking_words(sys.argv[1:])
    start_s = time.perf_counter()
    with reported("sweep"):
        check_files(ROOT / "conf")  # an unreadable file is one error here, not one for each job
        tracking = tracking_of(tracking_words)
        defaults = choices_of_study(job_words)
        sys.argv[1:] = command_line(job_words, defaults, folder)
        job()  # Hydra reads the command line and calls it once for each combination
    if job_records := read(folder):
        is_published = report(folder, job_records, defaults, tracking)
        print(
            f"{cost(job_records)}, {time.perf_counter() - start_s:.0f} s\n"
            f"sweep: table and figure in {folder}"
        )
        has_failed = any(record.error for record in job_records) or not is_published
        sys.exit(1 if has_failed else 0)


def choices_of_study(words: Sequence[str]) -> dict[str, str]:
    """The choices that the command line leaves open, by the study of its data set.

    They are the data set itself, its world, submaps and budget, and the study's first grid and
    method.
    """
    all_studies = read_listed_studies(ROOT / "conf")
    choices = {}
    for word in words:
        group, _, choice = word.partition("=")
        choices[group] = choice
    first_study = next(iter(all_studies))
    defaults = {"dataset": choices.get("dataset", first_study)}
    if study := all_studies.get(defaults["dataset"]):
        defaults |= {"world": study.world, "submap": study.submap, "budget": study.budget}
        defaults |= {"grid": study.grids[0].name, "method": study.methods[0].name}
    return {group: choice for group, choice in defaults.items() if group not in choices}


def command_line(words: Sequence[str], defaults: Mapping[str, str], folder: Path) -> list[str]:
    """Hydra's command line: a multirun into `folder`, unless the words contain other flags."""
    swept_keys = {key for key, _, value in (word.partition("=") for word in words) if "," in value}
    overrides = [
        _swept_with_group(word, swept_keys) for word in words if word not in ("-m", "--multirun")
    ]
    has_flags = any(word.startswith("-") for word in overrides)
    return [
        *([] if has_flags else ["-m"]),
        *overrides,
        f"hydra.sweep.dir={folder}",
        *(f"{group}={choice}" for group, choice in defaults.items()),
    ]


def _swept_with_group(word: str, swept_keys: Set[str]) -> str:
    """The override of a field in a group that is itself swept, as a sweep over one value."""
    # for a plain override, Hydra would look for the field in the group's default file
    key, _, value = word.partition("=")
    group = key.partition(".")[0]
    if group in swept_keys - {key} and value and "," not in value:
        return f"{key}=choice({value})"
    return word


def split_tracking_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the command line into the words for the jobs and those for MLflow.

    The jobs do not get the words for MLflow, which may contain a password: Hydra records the
    command line of each job.
    """
    tracking_words = [
        word for word in words if word.lstrip("+").startswith(("tracking.", "tracking="))
    ]
    return [word for word in words if word not in tracking_words], tracking_words


def tracking_of(words: Sequence[str]) -> DictConfig:
    """The settings of MLflow: conf/tracking with the overrides on the command line."""
    try:
        with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
            return compose("sweep", [*words]).tracking
    except CORRECTABLE:
        if not words:
            raise
        # the text of Hydra's own error may contain a password
        raise ConfigError(
            "tracking: not understood; expected KEY=VALUE with a key of conf/tracking/local.yaml"
        ) from None


def report(
    folder: Path, job_records: Sequence[Record], defaults: Mapping[str, str], tracking: DictConfig
) -> bool:
    """Write the table and figure of all jobs, and publish their runs to MLflow.

    Returns whether the runs could be published.
    """
    first_job = job_records[0]  # all jobs are of one data set
    print(sweep_report(folder, job_records, defaults))
    figures = [path for name in ("sweep.svg", "sweep.md") if (path := folder / name).is_file()]
    try:
        run = records.of_sweep(job_records, defaults, figures)
        experiment = experiment_of(first_job.dataset, first_job.simulated)
        published = publish(tracking.database, experiment, [run], files=tracking.artifacts)
    except YearlocError as error:
        print(f"sweep: {error}", file=sys.stderr)
        return False
    print(f"MLflow: {published.written} runs written, {published.kept} there already")
    return True


if __name__ == "__main__":
    main()
