"""Many values of any setting: one job each, every artifact built once, one table at the end.

python -m stages.sweep -m grid.cell_m=5,10,20 method.n_way=1,2,4
"""

import os
import sys
import time
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

from pipeline.errors import YearlocError
from pipeline.studies.known import studies
from pipeline.sweeps.record import Record, cost, read
from pipeline.tracking import records
from pipeline.tracking.runs import experiment_of, publish
from stages import ROOT
from stages.report import sweep_report
from stages.sweep.job import SWEEPS, job


def main() -> None:
    """Run the jobs, wherever the launcher says, and report on all of them."""
    folder = SWEEPS / "runs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    usual = usual_choices(sys.argv[1:])
    sys.argv[1:] = command_line(sys.argv[1:], usual, folder)
    start_s = time.perf_counter()
    job()
    if found := read(folder):
        wrong = report(folder, found, usual)
        print(f"{cost(found)}, {time.perf_counter() - start_s:.0f} s\nsweep: table and figure in {folder}")
        sys.exit(1 if wrong or any(record.error for record in found) else 0)


def usual_choices(given: Sequence[str]) -> dict[str, str]:
    """What the study says and the command line does not: its data set, world, submaps, budget, first grid and first method."""
    known, said = studies(ROOT / "conf"), dict(word.partition("=")[::2] for word in given)
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
    return [*flags, *words, f"hydra.sweep.dir={folder}", *(f"{group}={choice}" for group, choice in usual.items())]


def _for_each(word: str, swept: Set[str]) -> str:
    """An override; a field of a group that is swept itself as a choice of one, for Hydra would look for it in the usual file."""
    key, _, value = word.partition("=")
    return f"{key}=choice({value})" if key.partition(".")[0] in swept - {key} and value and "," not in value else word


def report(folder: Path, found: Sequence[Record], usual: Mapping[str, str]) -> bool:
    """One table and one figure of all jobs, and their runs in MLflow; whether those could not be written."""
    first = found[0]
    print(sweep_report(folder, found, usual))
    figures = [path for name in ("sweep.svg", "sweep.md") if (path := folder / name).is_file()]
    try:
        run = records.of_sweep(found, usual, figures)
        done = publish(Path(first.database), experiment_of(first.dataset, first.simulated), [run])
    except YearlocError as error:
        print(f"sweep: {error}", file=sys.stderr)
        return True
    print(f"MLflow: {done.written} runs written, {done.kept} there already")
    return False


if __name__ == "__main__":
    main()
