"""The section on poses: how near, how often, and whether the promised precision was kept."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.report import tables
from pipeline.report.figures import failures, maps, verdicts
from pipeline.report.figures.style import illustrate
from pipeline.report.render import anchor
from pipeline.report.result import Result, by_model
from pipeline.report.section import Illustration, Section
from pipeline.report.study import Study


def sections(study: Study, folder: Path) -> Iterator[Section]:
    """Draw the figures into `folder` and yield the section, if any model of the study has poses."""
    posed = [result for result in study.results if result.posed]
    if posed:
        yield Section(
            anchor(study.name, study.grid, "poses"),
            "poses",
            values={"study": study},
            illustrations=list(_illustrations(study, folder, posed)),
            tables=tables.poses(posed),
            sources=[study.source("evaluate", result.sequence, result.model) for result in posed],
        )


def _illustrations(study: Study, folder: Path, posed: list[Result]) -> Iterator[Illustration]:
    for model, group in by_model(posed).items():
        yield illustrate(
            "verdicts",
            verdicts.verdicts(group),
            study,
            folder,
            name=f"verdicts_{model}",
            model=model,
        )
        yield illustrate(
            "chances", verdicts.chances(group), study, folder, name=f"chances_{model}", model=model
        )
        if figure := failures.cards(study, group):
            yield illustrate(
                "failures", figure, study, folder, name=f"failures_{model}", model=model
            )
        last = group[-1]
        words = {"model": model, "sequence": last.sequence, "label": last.label}
        yield illustrate(
            "fixes",
            maps.fix_map(last, study.train_xy_m),
            study,
            folder,
            name=f"fixes_{model}",
            **words,
        )
