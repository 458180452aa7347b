"""Evaluations → the papers' figures and tables."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.reports.study import Study
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
    methods = [method.name for method in names.methods]
    return Study.gather(Path(cfg.artifacts), names.dataset, grid, names.train, names.tests, methods, cfg.dataset.simulated)


if __name__ == "__main__":
    main()
