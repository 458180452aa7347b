"""The whole report: markdown and figures of every study, and one HTML page.

In: the table of results and the artifacts of the studies. Out: a folder per study and cell size
with report.md, results.txt (for a terminal), its figures, and a list of them; and page.html.
"""

import json
import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.core.errors import ArtifactError
from pipeline.evaluation.rows import pick
from pipeline.report import findings, tables
from pipeline.report.render import caption, sentence, template, words
from pipeline.report.result import grouped
from pipeline.report.section import Section
from pipeline.report.sections import cases, lifelong, viewpoints, year
from pipeline.report.strategies import read_strategies
from pipeline.report.study import StudyResults
from pipeline.report.table import WIDEST
from pipeline.report.web import page
from pipeline.report.web.front import front
from pipeline.running.dvc_files import DvcLock
from pipeline.studies.layout import Layout
from pipeline.studies.study import Study as StudySettings

# The list of a study's figures, with the model and the sequence that each shows, for MLflow.
MANIFEST = "figures.json"


def write(
    folder: Path,
    layout: Layout,
    studies: Mapping[str, StudySettings],
    table: pd.DataFrame,
    least_queries: int,
    view: Callable[[str], Any],
    stale: Collection[str] = (),
) -> str:
    """Write every study's report and page.html into `folder`; returns a summary line.

    `view` makes the view of a name of conf/view. Fewer than `least_queries` seen queries near a
    real change say little. The page names the `stale` studies, which changed since they were
    measured.
    """
    entries = []
    for name, settings in studies.items():
        for grid in settings.grid_names:
            study = StudyResults(layout, settings, grid, pick(table, study=name))
            study_folder = folder / name / grid
            study_folder.mkdir(parents=True)
            sections = list(_sections(study, study_folder, least_queries, view))
            _write_study(study, study_folder, sections)
            first_screen = front(study) if settings.tests_over_days else None
            entries.append(page.Entry(study, sections, first_screen))
    if not entries:
        raise ArtifactError(f"{layout.root}: nothing to report yet; `dvc repro` builds the studies")
    path = folder / "page.html"
    lock = DvcLock.read(layout.root.parent / "dvc.lock")
    path.write_text(page.html(entries, lock, stale), encoding="utf-8")
    all_sections = [section for entry in entries for section in entry.sections]
    figures = sum(len(section.illustrations) for section in all_sections)
    study_count = "1 study" if len(studies) == 1 else f"{len(studies)} studies"
    size_mb = path.stat().st_size / 1e6
    return (
        f"{len(all_sections)} sections and {figures} figures of {study_count}; "
        f"page.html has {size_mb:.1f} MB"
    )


def _write_study(study: StudyResults, folder: Path, sections: Sequence[Section]) -> None:
    """Write the files of one study, whose figures lie in the folder already."""
    figures = [
        {
            "file": illustration.path.name,
            "model": illustration.values.get("model", ""),
            "sequence": illustration.values.get("sequence", ""),
        }
        for section in sections
        for illustration in section.illustrations
    ]
    drawn = len(list(folder.glob("*.svg")))
    for name, text in (
        ("report.md", template("report.md.j2", study=study, sections=sections, folder=folder)),
        ("results.txt", terminal_text(study, drawn) + "\n"),
        (MANIFEST, json.dumps(figures, indent=1) + "\n"),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def _sections(
    study: StudyResults, folder: Path, least_queries: int, view: Callable[[str], Any]
) -> Iterator[Section]:
    """Draw the figures of a study into its folder and yield its sections."""
    if study.settings.tests_over_days:
        yield from year.sections(study, folder, view)
        yield from cases.sections(study, folder, least_queries)
    if study.settings.learns_further_days:
        yield lifelong.section(study, folder)
    elif methods := study.settings.bird_view_methods:
        yield viewpoints.section(study, folder, view(methods[0].view))


def terminal_text(study: StudyResults, figures: int) -> str:
    """The text of a study for a terminal; `figures` is the number of figures in its report."""
    report = study.layout.path("report", study.name, study.grid, "report.md")
    return "\n".join([*_blocks(study), f"  {report}, with {figures} figures beside it\n"])


def _blocks(study: StudyResults) -> Iterator[str]:
    """The lines and tables of a study, as its experiment has them."""
    if study.settings.tests_over_days:
        yield f"{study.where}, trained on {study.training} alone, cells of {study.cell_m:g} m\n"
        yield tables.setup(study, longest=78).text()
        for protocol, number in product(tables.DISTANCE_FIRST, tables.MAIN_NUMBERS):
            main_table = tables.main_number(study, protocol, number)
            yield from (_wrap(caption(main_table)), main_table.text())
        yield from (tables.means(study).text(), _wrap(words("terminal")) + "\n")
        if posed := [result for result in study.results if result.posed]:
            for pose_table in tables.pose_tables(posed):
                yield from (_wrap(caption(pose_table)), pose_table.text())
        if caveats := [_wrap(sentence(caveat)) for caveat in findings.caveats(study)]:
            yield "\n".join(caveats) + "\n"
    if study.settings.learns_further_days:
        yield f"{study.where}: after the last step of learning, means over the seeds\n"
        for order, strategies in grouped(read_strategies(study.rows), "order").items():
            for order_table in tables.of_order(order, strategies):
                yield _wrap(caption(order_table)) + "\n" + order_table.text()
    elif study.settings.bird_view_methods:
        yield (
            f"{study.where}: each sequence matched with itself, from headings between the "
            "reference's\n"
        )
        yield from (viewpoint_table.text() for viewpoint_table in tables.over_headings(study))


def _wrap(line: str) -> str:
    """A sentence without its marks of markdown, in lines that a terminal has room for."""
    return textwrap.fill(line.replace("`", "").replace("*", ""), WIDEST - 20)
