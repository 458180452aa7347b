"""Evaluations at every cell size of a study → Fig. 11 of the SCI paper."""

from omegaconf import DictConfig

from pipeline import store
from pipeline.reports import cells
from pipeline.studies.expansion import spelled_out
from stages import stage
from stages.report import gather


@stage("cells")
def main(cfg: DictConfig) -> str:
    words = spelled_out(cfg.benchmark)[cfg.study]
    studies = {grid: gather(cfg, grid) for grid in (*words.grids, *words.cells)}
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        section = cells.section(
            folder,
            cfg.study,
            {grid: study.results for grid, study in studies.items()},
            {grid: study.cell_m for grid, study in studies.items()},
            cfg.dataset.simulated,
            tuple(f"{cfg.artifacts}/evaluate/{cfg.study}/{grid}" for grid in studies),
            {"budget": words.budget, "train": words.train, "tests": list(words.tests)},
        )
        section.write(folder)
    return section.answer[0]


if __name__ == "__main__":
    main()
