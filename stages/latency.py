"""The first test sequence's submaps → how long each method takes with one, on this machine: Table III of the SCI paper."""

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")  # heeded by what is imported from here on

from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from pipeline import schemas, store
from pipeline.evaluation.timing import Contender, Latency
from pipeline.reports import latency
from pipeline.studies.expansion import spelled_out
from stages import ROOT, made, stage


@stage("latency")
def main(cfg: DictConfig) -> str:
    words, artifacts = spelled_out(cfg.benchmark)[cfg.study], Path(cfg.artifacts)
    sequence = words.tests[0]
    submaps = artifacts / "submaps" / cfg.study
    training = len(store.read(submaps / f"{words.train}.zarr", schemas.SUBMAPS).load("scans"))
    scans = store.read(artifacts / "scans" / cfg.study / f"{sequence}.zarr", schemas.SCANS)
    models = artifacts / "train" / cfg.study / cfg.cells
    measured = Latency.measure(
        ready(words.methods, models), scans, store.read(submaps / f"{sequence}.zarr", schemas.SUBMAPS), cfg.queries, cfg.k
    )
    with store.replace(cfg.out) as folder:
        latency.write(measured, folder, cfg.study, sequence, training, cfg.dataset.simulated)
    return latency.line(measured)


def ready(methods: Any, models: Path) -> dict[str, Contender]:
    """Each method of a study with its view and its model, on one thread."""
    draw = {view: made("view", view) for view in dict.fromkeys(method.view for method in methods)}
    return {
        one.name: Contender(
            one.view, draw[one.view], alone(one.name).localizer(store.read_model(models / f"{one.name}.safetensors"))
        )
        for one in methods
    }


def alone(method: str) -> Any:
    """A method on one thread."""
    threads = {"threads": 1} if "threads" in OmegaConf.load(ROOT / "conf/method" / f"{method}.yaml") else {}
    return made("method", method, **threads)


if __name__ == "__main__":
    main()
