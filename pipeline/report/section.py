"""A section of a report: a question, findings, figures, tables, and sources of the numbers.

Templates write its words.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pipeline.report.figures.style import save
from pipeline.report.findings import Finding
from pipeline.report.study import Study
from pipeline.report.table import Table


@dataclass(frozen=True)
class Illustration:
    """A figure file of a section."""

    kind: str  # its key in templates/words.yaml: title and how to read it
    path: Path  # the SVG
    findings: Sequence[Finding] = ()  # what it shows here
    # what its words are filled with, such as the model and the sequence
    values: Mapping[str, Any] = field(default_factory=dict)
    on_page: bool = True  # whether the HTML page shows it too; the markdown report shows all


@dataclass(frozen=True)
class Section:
    """One part of a study's report."""

    name: str  # its anchor, such as campus-10m-turned
    kind: str  # its key in templates/words.yaml: title, question and remarks
    values: Mapping[str, Any] = field(default_factory=dict)  # what its words are filled with
    findings: Sequence[Finding] = ()  # the first is what a reader in a hurry takes away
    illustrations: Sequence[Illustration] = ()
    tables: Sequence[Table] = ()
    sources: Sequence[str] = ()  # paths of the artifacts that its numbers are from
    parameters: Mapping[str, Any] = field(default_factory=dict)  # what they were computed with


def illustrate(
    study: Study,
    folder: Path,
    kind: str,
    figure: Figure | None,
    *findings: Finding,
    name: str = "",
    **values: str,
) -> Illustration | None:
    """Save a figure as an SVG named by its kind or `name`; `values` fill its words.

    None where there is none.
    """
    if figure is None:
        return None
    path = save(figure, folder / f"{name or kind}.svg", study.simulated)
    return Illustration(kind, path, findings, values)


def section_of(
    study: Study,
    kind: str,
    values: Mapping[str, Any] | None = None,
    illustrations: Iterable[Illustration | None] = (),
    tables: Iterable[Table | None] = (),
    name: str = "",
    **parts: Any,
) -> Section:
    """A section of a study, named by its kind or `name`.

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
    """An HTML id made of names: runs of other characters than letters and digits become a dash."""
    return "-".join(re.sub(r"[^0-9A-Za-z]+", "-", name).strip("-") for name in names if name)
