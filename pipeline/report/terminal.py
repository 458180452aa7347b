"""The results as plain text for a terminal: each study's methods and main numbers, and where the report lies."""

import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import ArtifactError
from pipeline.evaluation import results
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report import tables, viewpoint_tables
from pipeline.report.render import caption, words
from pipeline.report.study import Study
from pipeline.report.table import WIDEST
from pipeline.studies.expansion import asks_about_the_year, on_bird_views


def text(artifacts: Path, studies: Mapping[str, Any]) -> str:
    """Of all studies; raises ArtifactError where there are no results or no report yet."""
    table, blocks = results.read(artifacts, list(studies)), []
    for name, own in studies.items():
        for grid in own["grids"]:
            study, report = Study(artifacts, name, own, grid, table[table["study"] == name]), artifacts / "report" / name / grid
            if not (report / "report.md").is_file():
                raise ArtifactError(f"{report}: no report yet; `dvc repro` writes it")
            blocks += [*_blocks(study), f"  {report}/report.md, with {len(list(report.glob('*.svg')))} figures beside it\n"]
    return "\n".join([*blocks, f"a page to read: {artifacts}/report/page.html; dashboard: make dashboard"])


def _blocks(study: Study) -> Iterator[str]:
    if asks_about_the_year(study.words):
        yield f"{study.where}, trained on {study.train} alone, cells of {study.cell_m:g} m\n"
        yield tables.setup(study, longest=78).text()
        for protocol in PROTOCOLS:
            for one in (tables.main(study, protocol, number) for number in tables.MAIN):
                yield from (_wrapped(caption(one)), one.text())
        yield from (tables.means(study).text(), _wrapped(words("terminal")) + "\n")
    if on_bird_views(study.words["methods"]):
        yield f"{study.where}: each sequence matched with itself, from headings between the reference's\n"
        yield from (one.text() for one in viewpoint_tables.over(study))


def _wrapped(line: str) -> str:
    return textwrap.fill(line.replace("`", "").replace("*", ""), WIDEST - 20)
