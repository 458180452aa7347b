"""Evaluations → the papers' figures and tables, and how the methods age."""

from collections.abc import Iterator
from pathlib import Path

from omegaconf import DictConfig

from pipeline import store
from pipeline.evaluation.ageing import Ageing
from pipeline.evaluation.events import Bands
from pipeline.formats.changes import read_changes
from pipeline.reports import ageing, events
from pipeline.reports.ageing_lines import held_out
from pipeline.reports.section import Section
from pipeline.reports.study import Study, folders
from pipeline.studies.expansion import spelled_out
from stages import stage


@stage("report")
def main(cfg: DictConfig) -> str:
    study = gather(cfg, cfg.cells)
    with store.replace(cfg.out) as folder:
        study.write(folder)
        for section in told(cfg, study, folder):
            section.write(folder / section.name.rpartition("-")[2])
    return f"{len(study.results)} evaluations drawn; read {cfg.out}/report.md"


def told(cfg: DictConfig, study: Study, folder: Path) -> Iterator[Section]:
    """How the methods age, and, of a study of robustness, what real changes near by do to them."""
    name, said = f"{cfg.study}-{cfg.cells}", {"train": study.train, "methods": {m: dict(r) for m, r in study.recipes.items()}}
    evaluations = f"{cfg.artifacts}/evaluate/{cfg.study}/{cfg.cells}"
    (folder / "ageing").mkdir()
    known = held_out(study.find, study.results)
    yield ageing.section(
        folder / "ageing", f"{name}-ageing", study.results, known, Ageing(), study.simulated, (evaluations,), said
    )
    changed = Path(cfg.artifacts, "events", cfg.study)
    if cfg.benchmark.studies[cfg.study].question == "robustness":
        (folder / "events").mkdir()
        changes = {result.sequence: read_changes(changed / f"{result.sequence}.csv") for result in study.results}
        yield events.section(
            folder / "events",
            f"{name}-events",
            study.results,
            changes,
            Bands(),
            study.bootstrap,
            study.simulated,
            (evaluations, str(changed)),
            said,
        )


def gather(cfg: DictConfig, grid: str) -> Study:
    """One study of conf/benchmark.yaml at one cell size."""
    words = spelled_out(cfg.benchmark)[cfg.study]
    views = {method.name: method.view for method in words.methods}
    find = folders(Path(cfg.artifacts), cfg.study, grid, views)
    return Study.gather(find, cfg.study, grid, words.train, words.tests, list(views), cfg.dataset.simulated)


if __name__ == "__main__":
    main()
