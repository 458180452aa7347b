"""A section of a report: a question, findings, figures, tables, and the sources of its numbers.

The modules of `sections` make sections with `illustrate` and `section_of`. Templates write them as
markdown and HTML; words.yaml holds their titles and sentences by `kind`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pipeline.report.figures.style import save
from pipeline.report.findings import Finding
from pipeline.report.study import StudyResults
from pipeline.report.table import Table


@dataclass(frozen=True)
class Illustration:
    """A figure file of a section."""

    kind: str  # the key of its words in templates/words.yaml: a title and how to read it
    path: Path  # the SVG
    findings: Sequence[Finding] = ()  # what it shows in this study
    # what fills its words, such as the model and the sequence
    values: Mapping[str, Any] = field(default_factory=dict)
    on_page: bool = True  # whether the HTML page shows it; the markdown report shows every figure


@dataclass(frozen=True)
class Section:
    """One part of a study's report."""

    name: str  # its anchor, such as campus-10m-turned
    kind: str  # the key of its words in templates/words.yaml: a title, a question and remarks
    values: Mapping[str, Any] = field(default_factory=dict)  # what fills its words
    findings: Sequence[Finding] = ()  # the first is what a reader in a hurry takes away
    illustrations: Sequence[Illustration] = ()
    tables: Sequence[Table] = ()
    sources: Sequence[str] = ()  # paths of the artifacts that its numbers are from
    parameters: Mapping[str, Any] = field(default_factory=dict)  # on which the numbers depend


def illustrate(
    study: StudyResults,
    folder: Path,
    kind: str,
    figure: Figure | None,
    *findings: Finding,
    name: str = "",
    **values: str,
) -> Illustration | None:
    """Save a figure of a study into `folder`, as an SVG named by its kind or `name`.

    `findings` say what it shows, `values` fill its words. None if there is no figure.
    """
    if figure is None:
        return None
    path = save(figure, folder / f"{name or kind}.svg", study.simulated)
    return Illustration(kind, path, findings, values)


def section_of(
    study: StudyResults,
    kind: str,
    values: Mapping[str, Any] | None = None,
    illustrations: Iterable[Illustration | None] = (),
    tables: Iterable[Table | None] = (),
    name: str = "",
    **parts: Any,
) -> Section:
    """A section of a study, named by its kind or `name`; `parts` are further fields of `Section`.

    Figures and tables that are None are left out.
    """
    return Section(
        anchor(study.name, study.grid, name or kind),
        kind,
        {"study": study, **(values or {})},
        illustrations=[illustration for illustration in illustrations if illustration],
        tables=[table for table in tables if table],
        **parts,
    )


def anchor(*names: str) -> str:
    """An HTML id made of names: letters and digits, with a dash for all between them."""
    return "-".join(re.sub(r"[^0-9A-Za-z]+", "-", name).strip("-") for name in names if name)
