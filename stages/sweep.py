"""Many values of any setting: one job each, every artifact built once, one table at the end.

python -m stages.sweep -m grid.cell_m=5,10,20 method.n_way=1,2,4
"""

import json
import math
import os
import sys
import time
import traceback
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline import schemas, store
from pipeline.errors import YearlocError
from pipeline.evaluation.held_out import held_out_auc
from pipeline.matching.rejection import Evidence
from pipeline.sweeps.chain import Step, expand
from pipeline.sweeps.job import Job
from pipeline.sweeps.ledger import Ledger
from pipeline.sweeps.record import Record, cost, read
from pipeline.sweeps.shelf import Shelf
from stages import ROOT
from stages._settings import Composer, listed, own_fields

SWEEPS = Path(".sweeps")
WRONG = (YearlocError, HydraException, OmegaConfBaseException)
"""What a person can put right."""

ConfigStore.instance().store("stage_fields", OmegaConf.create(own_fields()))


@hydra.main(version_base="1.3", config_path=str(ROOT / "conf"), config_name="sweep")
def job(cfg: DictConfig) -> float:
    """One job; returns its AUC on held-out blocks of training, NaN if it failed, for a sweeper that looks for the best."""
    of_hydra, begun, used = HydraConfig.get(), time.perf_counter(), time.process_time()
    said = {key: value for key, _, value in (override.partition("=") for override in of_hydra.overrides.task)}
    who = of_hydra.runtime.choices["dataset"], cfg.dataset.simulated, of_hydra.runtime.choices["method"], cfg.tracking.database
    record = Record(int(of_hydra.job.num), said, *who)
    try:
        record = replace(record, **_localised_for_a_year(cfg, said))
    except WRONG as error:
        plainest = error.__cause__ if isinstance(error.__cause__, YearlocError) else error
        record = replace(record, error=" ".join(str(plainest).split()))
    except Exception as error:  # one job's bug is no reason to lose the others
        traceback.print_exc()
        record = replace(record, error=f"{type(error).__name__}: {' '.join(str(error).split())}")
    record = replace(record, wall_s=time.perf_counter() - begun, cpu_s=time.process_time() - used)
    record.write(Path(of_hydra.sweep.dir))
    if record.error:
        print(f"job {record.number} failed: {record.error}", file=sys.stderr, flush=True)
    return math.nan if record.held_out_auc is None else record.held_out_auc


def _localised_for_a_year(cfg: DictConfig, said: Mapping[str, str]) -> dict[str, Any]:
    """What a job found out, and where its artifacts came from."""
    composer = Composer(said)
    steps = expand(yaml.safe_load((ROOT / "dvc.yaml").read_text()), listed(cfg, said))

    def run(step: Step, fields: Mapping[str, str]) -> None:
        line = import_module(f"stages.{step.stage}").main.run(composer.config(step, fields))
        print(f"{step.stage}: {line}", flush=True)

    found = Job(steps, Ledger(ROOT), Shelf(SWEEPS), composer.settings, run)
    train, localize, evaluate = (next(step for step in steps if step.stage == name) for name in ("train", "localize", "evaluate"))
    numbers = json.loads(found.path(evaluate.outs[1]).read_text())
    model = store.read_model(found.path(train.outs[0]))
    kind = store.read(found.path(localize.outs[0]) / f"{next(iter(numbers))}.zarr", schemas.RANKINGS).attrs["kinds"][0]
    rejection = composer.config(localize, {}).rejection
    counts = {name: dict(getattr(found, name)) for name in ("from_dvc", "from_sweeps", "built")}
    return {"numbers": numbers, "held_out_auc": held_out_auc(Evidence.of(model), kind, rejection.unseen_share), **counts}


def main() -> None:
    """Run the jobs, wherever the launcher says, and tell what came of all of them."""
    folder = SWEEPS / "runs" / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    given, studies = sys.argv[1:], yaml.safe_load((ROOT / "conf/benchmark.yaml").read_text())["benchmark"]["studies"]
    dataset = next((word.removeprefix("dataset=") for word in given if word.startswith("dataset=")), next(iter(studies)))
    study = studies.get(dataset, {})
    usual = {"dataset": dataset, **{group: study[group] for group in ("world", "submap", "budget") if study}}
    usual |= {"grid": study["grids"][0], "method": study["methods"][0]["name"]} if study else {}
    said = {word.partition("=")[0].removeprefix("benchmark.").removesuffix("s") for word in given}
    usual = {group: choice for group, choice in usual.items() if group not in said}
    swept = {key for key, _, value in (word.partition("=") for word in given) if "," in value}
    given = [_of_each(word, swept) for word in given if word not in ("-m", "--multirun")]
    flags = [] if any(word.startswith("-") for word in given) else ["-m"]
    sys.argv[1:] = [*flags, *given, f"hydra.sweep.dir={folder}", *(f"{group}={choice}" for group, choice in usual.items())]
    begun = time.perf_counter()
    job()
    if records := read(folder):
        wrong = _tell(folder, records, usual)
        print(f"{cost(records)}, {time.perf_counter() - begun:.0f} s\nsweep: table and figure in {folder}")
        sys.exit(1 if wrong or any(record.error for record in records) else 0)


def _of_each(word: str, swept: Set[str]) -> str:
    """An override; a field of a group that is swept itself as a choice of one, for Hydra would look for it in the usual file."""
    key, _, value = word.partition("=")
    return f"{key}=choice({value})" if key.partition(".")[0] in swept - {key} and value and "," not in value else word


def _tell(folder: Path, records: Sequence[Record], usual: Mapping[str, str]) -> bool:
    """One table and one figure of all jobs, and their runs in MLflow; whether those could not be written."""
    from pipeline.reports import trials
    from pipeline.reports.sweep import Job as Line
    from pipeline.reports.sweep import Sweep
    from pipeline.tracking.runs import experiment_of, publish

    lines = []
    for one in records:
        own = {key: value for key, value in one.overrides.items() if key not in usual}
        lines.append(Line(one.number, own, one.numbers, one.held_out_auc, one.error))
    first = records[0]
    sweep = Sweep(lines, first.dataset, first.simulated)
    sweep.write(folder)
    figures = [path for name in ("sweep.svg", "sweep.md") if (path := folder / name).is_file()]
    runs = [trials.record(sweep, first.method, figures)]
    print(sweep.text())
    try:
        done = publish(Path(first.database), experiment_of(first.dataset, first.simulated), runs)
    except YearlocError as error:
        print(f"sweep: {error}", file=sys.stderr)
        return True
    print(f"MLflow: {done.written} runs written, {done.kept} there already")
    return False


if __name__ == "__main__":
    main()
