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

from pipeline.errors import ConfigError, YearlocError
from pipeline.running.texts import check_files
from pipeline.studies.known import studies
from pipeline.sweeps.record import Record, cost, read
from pipeline.tracking import records
from pipeline.tracking.runs import experiment_of, publish
from stages import ROOT, reported
from stages.report import sweep_report
from stages.sweep.job import CORRECTABLE, SWEEPS, job


def main() -> None:
    """Run the jobs, wherever the launcher says, and report on all of them."""
    folder = SWEEPS / "runs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    given, about = apart(sys.argv[1:])
    start_s = time.perf_counter()
    with reported("sweep"):
        check_files(ROOT / "conf")  # else each job fails for itself
        tracking = tracking_of(about)
        usual = usual_choices(given)
        sys.argv[1:] = command_line(given, usual, folder)
        job()
    if found := read(folder):
        wrong = report(folder, found, usual, tracking)
        print(
            f"{cost(found)}, {time.perf_counter() - start_s:.0f} s\nsweep: table and figure in "
            f"{folder}"
        )
        sys.exit(1 if wrong or any(record.error for record in found) else 0)


def usual_choices(given: Sequence[str]) -> dict[str, str]:
    """What the study says and the command line does not: its data set, world, submaps, budget,
    first grid and first method."""
    known = studies(ROOT / "conf")
    said = dict(word.partition("=")[::2] for word in given)
    usual = {"dataset": said.get("dataset", next(iter(known)))}
    if study := known.get(usual["dataset"]):
        usual |= {group: study[group] for group in ("world", "submap", "budget")}
        usual |= {"grid": study["grids"][0], "method": study["methods"][0]["name"]}
    return {group: choice for group, choice in usual.items() if group not in said}


def command_line(given: Sequence[str], usual: Mapping[str, str], folder: Path) -> list[str]:
    """What Hydra is given: a multirun into `folder`, unless other flags are."""
    swept = {key for key, _, value in (word.partition("=") for word in given) if "," in value}
    words = [_for_each(word, swept) for word in given if word not in ("-m", "--multirun")]
    flags = [] if any(word.startswith("-") for word in words) else ["-m"]
    return [
        *flags,
        *words,
        f"hydra.sweep.dir={folder}",
        *(f"{group}={choice}" for group, choice in usual.items()),
    ]


def _for_each(word: str, swept: Set[str]) -> str:
    """An override; a field of a group that is swept itself as a choice of one, for Hydra would look
    for it in the usual file."""
    key, _, value = word.partition("=")
    return (
        f"{key}=choice({value})"
        if key.partition(".")[0] in swept - {key} and value and "," not in value
        else word
    )


def apart(given: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words for the jobs; and those about MLflow, which no job gets: Hydra writes down what
    each job was told."""
    about = [word for word in given if word.lstrip("+").startswith(("tracking.", "tracking="))]
    return [word for word in given if word not in about], about


def tracking_of(words: Sequence[str]) -> DictConfig:
    """Where MLflow is, by the words that say so."""
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
    folder: Path, found: Sequence[Record], usual: Mapping[str, str], tracking: DictConfig
) -> bool:
    """One table and one figure of all jobs, and their runs in MLflow; whether those could not be
    written."""
    first = found[0]
    print(sweep_report(folder, found, usual))
    figures = [path for name in ("sweep.svg", "sweep.md") if (path := folder / name).is_file()]
    try:
        run = records.of_sweep(found, usual, figures)
        experiment = experiment_of(first.dataset, first.simulated)
        done = publish(tracking.database, experiment, [run], files=tracking.artifacts)
    except YearlocError as error:
        print(f"sweep: {error}", file=sys.stderr)
        return True
    print(f"MLflow: {done.written} runs written, {done.kept} there already")
    return False


if __name__ == "__main__":
    main()
