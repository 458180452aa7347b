"""A model of the first day, and further days → what it answers after each, by a strategy of
learning."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import store
from pipeline.lifelong.courses import Course
from pipeline.lifelong.record import Record
from pipeline.matching.ranking import Rows
from pipeline.online.pack import Packing
from pipeline.schemas_lifelong import LIFELONG
from pipeline.studies.expansion import model_named
from pipeline.studies.known import studies
from stages import ROOT, ProgressBar, stage, within_budget


@stage("lifelong")
def main(cfg: DictConfig) -> str:
    cfg = within_budget(cfg, HydraConfig.get().overrides.task)
    strategy = instantiate(cfg.strategy.way)
    progress = ProgressBar(float(cfg.budget.share))
    asked = {name: Rows.read(Path(cfg.views, f"{name}.zarr")) for name in cfg.asked.split()}
    course = Course(
        Path(cfg.artifacts),
        cfg.study,
        cfg.cells,
        cfg.name,
        cfg.train,
        cfg.learned.split(),
        Path(cfg.views),
    )
    packing = Packing(ROOT / "conf", course.artifacts, studies(ROOT / "conf"))
    with TemporaryDirectory() as scratch:
        found = course.steps(
            cfg.order, strategy, instantiate(cfg.method), packing, Path(scratch), progress
        )
        record = Record.of(found, asked, progress.tell)
    own = {"order": cfg.order, "strategy": cfg.strategy.name, "asked": [*asked]}
    attrs = {**own, **record.attrs, "correct_m": float(cfg.tolerance.distance.correct_m)}
    with store.write(cfg.out, LIFELONG, **attrs) as out:
        for name, column in record.columns.items():
            out.put(name, column)
    model = model_named(studies(ROOT / "conf")[cfg.study], cfg.name)
    place = {
        "study": cfg.study,
        "dataset": cfg.study,
        "simulated": cfg.dataset.simulated,
        "grid": cfg.cells,
        **model.columns,
    }
    with store.replace(cfg.timing) as path:
        told = {"place": place, **attrs, "cpu_s": [one.cpu_s for one in record.steps]}
        path.write_text(json.dumps(told, allow_nan=False) + "\n", encoding="utf-8")
    return record.line()


if __name__ == "__main__":
    main()
