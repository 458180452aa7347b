"""The first test sequence's submaps and the models → what a query and a training cost on this
machine (SCI paper, Table III)."""

import os

os.environ.update(
    OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1"
)  # heeded by what is imported from here on

import json
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from pipeline import schemas, store
from pipeline.evaluation.rows import table
from pipeline.evaluation.timing import Latency, contenders, cost_rows
from pipeline.studies.expansion import models_of
from pipeline.studies.known import studies
from stages import ROOT, build, stage


@stage("latency")
def main(cfg: DictConfig) -> str:
    study = studies(ROOT / "conf")[cfg.study]
    artifacts = Path(cfg.artifacts)
    sequence = study["tests"][0]
    models = artifacts / "train" / cfg.study / cfg.cells
    scans = store.read(artifacts / "scans" / cfg.study / f"{sequence}.zarr", schemas.SCANS)
    submaps = store.read(artifacts / "submaps" / cfg.study / f"{sequence}.zarr", schemas.SUBMAPS)
    methods = contenders(study["methods"], models, lambda view: build("view", view), alone)
    measured = Latency.measure(methods, scans, submaps, cfg.queries, cfg.k)
    trained = {
        name: models / f"{name.name}{store.MODEL}"
        for method in study["methods"]
        for name in models_of(method)
    }
    common = {
        "study": cfg.study,
        "dataset": cfg.study,
        "simulated": cfg.dataset.simulated,
        "grid": cfg.cells,
    }
    with store.replace(cfg.out) as path:
        table([*measured.rows(), *cost_rows(trained)], **common).to_csv(path, index=False)
    with store.replace(cfg.samples) as path:
        text = json.dumps({"sequence": sequence, **measured.record()}, allow_nan=False)
        path.write_text(f"{text}\n", encoding="utf-8")
    return measured.line()


def alone(method: str) -> Any:
    """A method on one thread."""
    threads = (
        {"threads": 1}
        if "threads" in OmegaConf.load(ROOT / "conf/method" / f"{method}.yaml")
        else {}
    )
    return build("method", method, **threads)


if __name__ == "__main__":
    main()
