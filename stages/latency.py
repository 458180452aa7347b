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
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from stages import ROOT, build, stage


@stage("latency")
def main(cfg: DictConfig) -> str:
    study = studies(ROOT / "conf")[cfg.study]
    layout = Layout(Path(cfg.artifacts))
    sequence = study.tests[0]
    scans = store.read(layout.path("scans", study.name, sequence), schemas.Scans)
    submaps = store.read(layout.path("submaps", study.name, sequence), schemas.Submaps)
    methods = contenders(study, cfg.cells, layout, lambda view: build("view", view), alone)
    measured = Latency.measure(methods, scans, submaps, cfg.queries, cfg.k)
    trained = {
        model: layout.path("train", study.name, cfg.cells, model.name) for model in study.models
    }
    common = {
        "study": study.name,
        "dataset": study.name,
        "simulated": study.simulated,
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
