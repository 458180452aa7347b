"""Many values of any setting: one job each, every artifact built once, one table at the end.

python -m stages.sweep -m grid.cell_m=5,10,20 method.n_way=1,2,4
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
    """Run the jobs, wherever the launcher says, and report on all of them."""
    folder = SWEEPS / "runs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    job_words, tracking_words = split_tracking_words(sys.argv[1:])
    start_s = time.perf_counter()
    with reported("sweep"):
        check_files(ROOT / "conf")  # else each job fails for itself
        tracking = tracking_of(tracking_words)
        defaults = usual_choices(job_words)
        sys.argv[1:] = command_line(job_words, defaults, folder)
        job()
    if job_records := read(folder):
        wrong = report(folder, job_records, defaults, tracking)
        print(
            f"{cost(job_records)}, {time.perf_counter() - start_s:.0f} s\n"
            f"sweep: table and figure in {folder}"
        )
        sys.exit(1 if wrong or any(record.error for record in job_records) else 0)


def usual_choices(words: Sequence[str]) -> dict[str, str]:
    """The study's choices that the command line does not make.

    Its data set, world, submaps, budget, first grid and first method.
    """
    all_studies = read_listed_studies(ROOT / "conf")
    chosen_words = dict(word.partition("=")[::2] for word in words)
    defaults = {"dataset": chosen_words.get("dataset", next(iter(all_studies)))}
    if study := all_studies.get(defaults["dataset"]):
        defaults |= {"world": study.world, "submap": study.submap, "budget": study.budget}
        defaults |= {"grid": study.grids[0].name, "method": study.methods[0].name}
    return {group: choice for group, choice in defaults.items() if group not in chosen_words}


def command_line(words: Sequence[str], defaults: Mapping[str, str], folder: Path) -> list[str]:
    """Hydra's command line: a multirun into `folder`, unless it has other flags."""
    swept = {key for key, _, value in (word.partition("=") for word in words) if "," in value}
    overrides = [_for_each(word, swept) for word in words if word not in ("-m", "--multirun")]
    flags = [] if any(word.startswith("-") for word in overrides) else ["-m"]
    return [
        *flags,
        *overrides,
        f"hydra.sweep.dir={folder}",
        *(f"{group}={choice}" for group, choice in defaults.items()),
    ]


def _for_each(word: str, swept: Set[str]) -> str:
    """An override; a field of a swept group itself becomes a choice of one.

    Hydra would look for it in the usual file otherwise.
    """
    key, _, value = word.partition("=")
    return (
        f"{key}=choice({value})"
        if key.partition(".")[0] in swept - {key} and value and "," not in value
        else word
    )


def split_tracking_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words for the jobs, and those about MLflow.

    No job gets the latter: Hydra writes down what each job was told.
    """
    tracking_words = [
        word for word in words if word.lstrip("+").startswith(("tracking.", "tracking="))
    ]
    return [word for word in words if word not in tracking_words], tracking_words


def tracking_of(words: Sequence[str]) -> DictConfig:
    """The settings of MLflow, by the words about it."""
    try:
        with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
            return compose("sweep", [*words]).tracking
    except CORRECTABLE:
        if not words:
            raise
        # else its text may hold a password
        raise ConfigError(
            "tracking: not understood; expected KEY=VALUE with a key of conf/tracking/local.yaml"
        ) from None


def report(
    folder: Path, job_records: Sequence[Record], defaults: Mapping[str, str], tracking: DictConfig
) -> bool:
    """Write the table and figure of all jobs, and publish their runs to MLflow.

    Returns whether those could not be written.
    """
    first = job_records[0]
    print(sweep_report(folder, job_records, defaults))
    figures = [path for name in ("sweep.svg", "sweep.md") if (path := folder / name).is_file()]
    try:
        run = records.of_sweep(job_records, defaults, figures)
        experiment = experiment_of(first.dataset, first.simulated)
        published = publish(tracking.database, experiment, [run], files=tracking.artifacts)
    except YearlocError as error:
        print(f"sweep: {error}", file=sys.stderr)
        return True
    print(f"MLflow: {published.written} runs written, {published.kept} there already")
    return False


if __name__ == "__main__":
    main()
