"""Evaluations → the papers' figures and tables."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.reports.study import Study, folders
from stages import stage


@stage("report")
def main(cfg: DictConfig) -> str:
    study = gather(cfg, cfg.cells)
    with store.replace(cfg.out) as folder:
        study.write(folder)
    return f"{len(study.results)} evaluations drawn; read {cfg.out}/report.md"


def gather(cfg: DictConfig, grid: str) -> Study:
    """The study of conf/benchmark.yaml at one cell size."""
    names = cfg.benchmark
    views = {method.name: method.view for method in names.methods}
    find = folders(Path(cfg.artifacts), names.dataset, grid, views)
    return Study.gather(find, names.dataset, grid, names.train, names.tests, list(views), cfg.dataset.simulated)


if __name__ == "__main__":
    main()
