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
from pipeline.lifelong.record import line, record
from pipeline.matching.ranking import Rows
from pipeline.online.pack import Packing
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from stages import ROOT, ProgressBar, stage, within_budget


@stage("lifelong")
def main(cfg: DictConfig) -> str:
    cfg = within_budget(cfg, HydraConfig.get().overrides.task)
    strategy = instantiate(cfg.strategy.way)
    progress = ProgressBar(float(cfg.budget.share))
    queries = {name: Rows.read(Path(cfg.views, f"{name}.zarr")) for name in cfg.asked.split()}
    course = Course(
        Layout(Path(cfg.artifacts)),
        cfg.study,
        cfg.cells,
        cfg.name,
        cfg.train,
        cfg.learned.split(),
        Path(cfg.views),
    )
    known_studies = studies(ROOT / "conf")
    packing = Packing(ROOT / "conf", course.layout, known_studies)
    with TemporaryDirectory() as scratch:
        steps = course.steps(
            cfg.order, strategy, instantiate(cfg.method), packing, Path(scratch), progress
        )
        lifelong, cpu_s = record(
            steps,
            queries,
            progress.tell,
            cfg.order,
            cfg.strategy.name,
            float(cfg.tolerance.distance.correct_m),
        )
    store.write(cfg.out, lifelong)
    study = known_studies[cfg.study]
    model = study.model_named(cfg.name)
    place = {
        "study": study.name,
        "dataset": study.name,
        "simulated": study.simulated,
        "grid": cfg.cells,
        **model.columns,
    }
    with store.replace(cfg.timing) as path:
        timing = {"place": place, **lifelong.attrs, "cpu_s": cpu_s}
        path.write_text(json.dumps(timing, allow_nan=False) + "\n", encoding="utf-8")
    return line(lifelong)


if __name__ == "__main__":
    main()
