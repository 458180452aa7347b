"""One job of a sweep: builds what its overrides touch, takes the rest from DVC or earlier jobs, and leaves a record of it."""

import json
import math
import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline import schemas, store
from pipeline.errors import ConfigError, YearlocError
from pipeline.evaluation.held_out import held_out_auc
from pipeline.matching.rejection import Evidence
from pipeline.running.dvc_files import definition
from pipeline.sweeps.cache import ArtifactCache
from pipeline.sweeps.chain import Step, expand
from pipeline.sweeps.job import Job
from pipeline.sweeps.lock import UpToDate
from pipeline.sweeps.record import Record
from stages import ROOT
from stages._studies import studies
from stages.sweep.settings import Composer, listed, own_fields

SWEEPS = Path(".sweeps")
CORRECTABLE = (YearlocError, HydraException, OmegaConfBaseException)
"""What a person can put right."""

ConfigStore.instance().store("stage_fields", OmegaConf.create(own_fields()))


@hydra.main(version_base="1.3", config_path=str(ROOT / "conf"), config_name="sweep")
def job(cfg: DictConfig) -> float:
    """Run one job; returns its AUC on held-out blocks of training, NaN if it failed, for a sweeper that looks for the best."""
    of_hydra, start_s, used_s = HydraConfig.get(), time.perf_counter(), time.process_time()
    overrides = {key: value for key, _, value in (override.partition("=") for override in of_hydra.overrides.task)}
    about = of_hydra.runtime.choices["dataset"], cfg.dataset.simulated, of_hydra.runtime.choices["method"], cfg.tracking.database
    record = Record(int(of_hydra.job.num), overrides, *about)
    try:
        record = replace(record, **localize_for_a_year(cfg, overrides, record.dataset))
    except CORRECTABLE as error:
        plainest = error.__cause__ if isinstance(error.__cause__, YearlocError) else error
        record = replace(record, error=" ".join(str(plainest).split()))
    except Exception as error:  # one job's bug is no reason to lose the others
        traceback.print_exc()
        record = replace(record, error=f"{type(error).__name__}: {' '.join(str(error).split())}")
    record = replace(record, wall_s=time.perf_counter() - start_s, cpu_s=time.process_time() - used_s)
    record.write(Path(of_hydra.sweep.dir))
    if record.error:
        print(f"job {record.number} failed: {record.error}", file=sys.stderr, flush=True)
    return math.nan if record.held_out_auc is None else record.held_out_auc


def localize_for_a_year(cfg: DictConfig, overrides: Mapping[str, str], dataset: str) -> dict[str, Any]:
    """A job's metrics, and where its artifacts came from."""
    if dataset not in (known := studies()):
        raise ConfigError(f"dataset={dataset}: conf/studies.yaml has {', '.join(known)}; `yearloc use` changes it")
    composer = Composer(overrides)

    def run(step: Step, fields: Mapping[str, str]) -> None:
        line = import_module(f"stages.{step.stage}").main.run(composer.config(step, fields))
        print(f"{step.stage}: {line}", flush=True)

    for altered in (
        known[dataset].get("altered", {}),
        dict[str, Any](),
    ):  # altered queries are asked only where DVC has their answers
        lists = listed({**known[dataset], "altered": altered}, dataset, overrides, cfg.method.view)
        steps = expand(definition(ROOT), lists)
        found = Job(steps, UpToDate(ROOT), ArtifactCache(SWEEPS), composer.settings, run)
        train, localize, evaluate = (
            next(one for one in steps if one.stage == name) for name in ("train", "localize", "evaluate")
        )
        if found.is_built(localize):
            break
    numbers = json.loads(found.path(evaluate.outs[1]).read_text())
    model = store.read_model(found.path(train.outs[0]))
    kind = store.read(found.path(localize.outs[0]) / f"{next(iter(numbers))}.zarr", schemas.RANKINGS).attrs["kinds"][0]
    rejection = composer.config(localize, {}).rejection
    counts = {name: dict(getattr(found, name)) for name in ("from_dvc", "from_sweeps", "built")}
    return {"numbers": numbers, "held_out_auc": held_out_auc(Evidence.of(model), kind, rejection.unseen_share), **counts}
