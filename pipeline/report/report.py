"""The whole report: markdown and figures of every study, and one HTML page."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.core.errors import ArtifactError
from pipeline.report import terminal
from pipeline.report.render import template
from pipeline.report.section import Section
from pipeline.report.sections import cases, lifelong, viewpoints, year
from pipeline.report.study import Study
from pipeline.report.web import page
from pipeline.report.web.front import front
from pipeline.running.dvc_files import DvcLock
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study as StudySettings

# which figure files a study has, and whose they are: MLflow shows them beside model and sequence
MANIFEST = "figures.json"


def write(
    folder: Path,
    layout: Layout,
    studies: Mapping[str, StudySettings],
    table: pd.DataFrame,
    few: int,
    view: Callable[[str], Any],
    stale: Collection[str] = (),
) -> str:
    """Write every study's report and page.html into `folder`; returns a summary line.

    `view` makes the view of a name of conf/view. Fewer than `few` seen queries near a real
    change say little. The page names the `stale` studies, which changed since they were measured.
    """
    entries = []
    for name, settings in studies.items():
        for grid in settings.grid_names:
            study = Study(layout, settings, grid, table[table["study"] == name])
            study_folder = folder / name / grid
            study_folder.mkdir(parents=True)
            study_sections = list(_sections(study, study_folder, few, view))
            (study_folder / "report.md").write_text(
                template("report.md.j2", study=study, sections=study_sections, folder=study_folder),
                encoding="utf-8",
            )
            files = [
                {"file": illustration.path.name}
                | {key: illustration.values.get(key, "") for key in ("model", "sequence")}
                for section in study_sections
                for illustration in section.illustrations
            ]
            (study_folder / "results.txt").write_text(
                terminal.text(study, len(list(study_folder.glob("*.svg")))) + "\n", encoding="utf-8"
            )
            (study_folder / MANIFEST).write_text(
                json.dumps(files, indent=1) + "\n", encoding="utf-8"
            )
            entries.append(
                page.Entry(
                    study, study_sections, front(study) if settings.asks_about_the_year else None
                )
            )
    if not entries:
        raise ArtifactError(f"{layout.root}: nothing to report yet; `dvc repro` builds the studies")
    path = folder / "page.html"
    path.write_text(
        page.html(entries, DvcLock.read(layout.root.parent / "dvc.lock"), stale), encoding="utf-8"
    )
    sections = [section for entry in entries for section in entry.sections]
    figures = sum(len(section.illustrations) for section in sections)
    study_count = "1 study" if len(studies) == 1 else f"{len(studies)} studies"
    size_mb = path.stat().st_size / 1e6
    return (
        f"{len(sections)} sections and {figures} figures of {study_count}; "
        f"page.html has {size_mb:.1f} MB"
    )


def _sections(
    study: Study, folder: Path, few: int, view: Callable[[str], Any]
) -> Iterator[Section]:
    if study.settings.asks_about_the_year:
        yield from year.sections(study, folder, view)
        yield from cases.sections(study, folder, few)
    if study.settings.learns_further_days:
        yield lifelong.section(study, folder)
    elif methods := study.settings.bird_view_methods:
        yield viewpoints.section(study, folder, view(methods[0].view))
