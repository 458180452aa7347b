"""One job of a sweep: runs the chain with some settings changed, and writes a record of it.

It builds only the artifacts that depend on the changed settings. It takes all others from DVC, if
they are there and up to date, or from earlier jobs (`pipeline.sweeps`).
"""

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

from pipeline.core import store
from pipeline.core.errors import ConfigError, YearlocError
from pipeline.evaluation.evaluations import Evaluations
from pipeline.evaluation.rows import TableRows, evaluation_rows, row
from pipeline.evaluation.validation import validation_auc
from pipeline.matching.rejection import NoveltyEvidence
from pipeline.running.dvc_files import definition
from pipeline.studies.studies_file import read_listed_studies
from pipeline.studies.study import Study
from pipeline.sweeps.chain import Step, expand
from pipeline.sweeps.lock import UpToDate
from pipeline.sweeps.record import Record
from pipeline.sweeps.resolver import ArtifactCache, ArtifactResolver
from stages import ROOT
from stages.sweep.settings import Composer, lists_of_job, own_fields

SWEEPS = Path(".sweeps")
"""The folder of all artifacts that sweeps build, and of their records."""
EMPTY_STAGE = "absent"
"""The stage that makes empty folders in place of artifacts that a study lacks; they are not counted
as artifacts."""
CORRECTABLE = (YearlocError, HydraException, OmegaConfBaseException)
"""Errors that a user can correct."""

# conf/sweep.yaml includes these fields of the stages by this name, so that a job may change them,
# as localize.k=10 does. Hydra looks in its store for names that are not files.
ConfigStore.instance().store("stage_fields", OmegaConf.create(own_fields()))


@hydra.main(version_base="1.3", config_path=str(ROOT / "conf"), config_name="sweep")
def job(cfg: DictConfig) -> float:
    """Run one job; returns the AUC on validation blocks, which an optimising sweeper maximises.

    The AUC is NaN if the job failed.
    """
    hydra_run = HydraConfig.get()
    start_s = time.perf_counter()
    start_cpu_s = time.process_time()
    overrides = dict(override.split("=", 1) for override in hydra_run.overrides.task)
    choices = hydra_run.runtime.choices
    record = Record(
        number=int(hydra_run.job.num),
        overrides=overrides,
        dataset=choices["dataset"],
        simulated=cfg.dataset.simulated,
        method=choices["method"],
    )
    try:
        record = replace(record, **run_chain(cfg, overrides, record.dataset))
    except CORRECTABLE as error:
        # Hydra wraps errors raised while it instantiates a class.
        cause = error.__cause__ if isinstance(error.__cause__, YearlocError) else error
        record = replace(record, error=" ".join(str(cause).split()))
    except Exception as error:  # a bug in one job must not stop the others
        traceback.print_exc()
        record = replace(record, error=f"{type(error).__name__}: {' '.join(str(error).split())}")
    record = replace(
        record, wall_s=time.perf_counter() - start_s, cpu_s=time.process_time() - start_cpu_s
    )
    record.write(Path(hydra_run.sweep.dir))
    if record.error:
        print(f"job {record.number} failed: {record.error}", file=sys.stderr, flush=True)
    return math.nan if record.validation_auc is None else record.validation_auc


def run_chain(cfg: DictConfig, overrides: Mapping[str, str], dataset: str) -> dict[str, Any]:
    """Find or build the artifacts of a job; returns its results and where the artifacts came from.

    The keys are fields of `Record`: the rows of the table of results, and three counts of
    artifacts. Raises ConfigError for a data set without a study.
    """
    all_studies = read_listed_studies(ROOT / "conf")
    if dataset not in all_studies:
        raise ConfigError(
            f"dataset={dataset}: conf/studies.yaml has {', '.join(all_studies)}; "
            "`yearloc use` changes it"
        )
    composer = Composer(overrides)

    def run(step: Step, fields: Mapping[str, str]) -> None:
        """Run a stage in this process, with `fields` for its paths and names."""
        # The decorator `stages.stage` adds `run`, which runs the stage without a command line.
        stage_function = import_module(f"stages.{step.stage}").main
        line = stage_function.run(composer.config(step, fields))
        print(f"{step.stage}: {line}", flush=True)

    def plan(study: Study) -> tuple[ArtifactResolver, dict[str, Step]]:
        """The resolver of the job's artifacts, and the steps of the chain, by stage."""
        steps = expand(definition(ROOT), lists_of_job(study, overrides, cfg.method.view))
        artifacts = ArtifactResolver(
            steps, UpToDate(ROOT), ArtifactCache(SWEEPS), composer.settings, run
        )
        return artifacts, {step.stage: step for step in steps}

    study = all_studies[dataset]
    artifacts, step_of = plan(study)
    # Perturbed queries take long: they are used only if DVC has their rankings already.
    if not artifacts.dvc_has(step_of["localize"]):
        artifacts, step_of = plan(replace(study, perturbed={}))
    # This setting does not depend on the fields for paths and names, which are left out.
    unseen_share = composer.config(step_of["localize"], {}).rejection.unseen_share
    # This finds or builds the artifacts, so it comes before their counts are read.
    rows = list(results(artifacts, step_of["evaluate"], step_of["train"], unseen_share))
    counts = {
        origin: {stage: count for stage, count in counts.items() if stage != EMPTY_STAGE}
        for origin, counts in artifacts.counts.items()
    }
    return {"rows": rows, **counts}


def results(
    artifacts: ArtifactResolver, evaluate: Step, train: Step, unseen_share: float
) -> TableRows:
    """The job's rows of results: its test sequences unperturbed, and its AUC on validation blocks.

    The AUC is a row as well, from which `Record.validation_auc` takes it.
    """
    folder = artifacts.obtain(evaluate.outs[0])
    sequences = evaluate.fields["sequences"].split()
    evaluations = {
        sequence: store.read(folder / f"{sequence}.zarr", Evaluations).case()
        for sequence in sequences
    }
    # the first kind of novelty is in use; it is the same for all sequences
    kind, *_ = evaluations[sequences[-1]].kinds
    for sequence, evaluation in evaluations.items():
        yield from (
            {"sequence": sequence, "days": evaluation.days, **columns}
            for columns in evaluation_rows(evaluation)
        )
    evidence = NoveltyEvidence.of(store.read_model(artifacts.obtain(train.outs[0])))
    yield row("validation_auc", "cells", validation_auc(evidence, kind, unseen_share))
