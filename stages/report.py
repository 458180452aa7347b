"""Evaluations → the papers' figures and tables."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.reports.study import Study, folders
from pipeline.studies import spelled_out
from stages import stage


@stage("report")
def main(cfg: DictConfig) -> str:
    study = gather(cfg, cfg.cells)
    with store.replace(cfg.out) as folder:
        study.write(folder)
    return f"{len(study.results)} evaluations drawn; read {cfg.out}/report.md"


def gather(cfg: DictConfig, grid: str) -> Study:
    """One study of conf/benchmark.yaml at one cell size."""
    words = spelled_out(cfg.benchmark)[cfg.study]
    views = {method.name: method.view for method in words.methods}
    find = folders(Path(cfg.artifacts), cfg.study, grid, views)
    return Study.gather(find, cfg.study, grid, words.train, words.tests, list(views), cfg.dataset.simulated)


if __name__ == "__main__":
    main()
