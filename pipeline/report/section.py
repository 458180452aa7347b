"""A section of a report: a question, what was found, figures, tables, and where the numbers lie. Templates write its words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.report.findings import Finding
from pipeline.report.table import Table


@dataclass(frozen=True)
class Illustration:
    """A figure file of a section."""

    kind: str
    """Its key in templates/words.yaml, which says its title and how to read it."""
    path: Path
    """The SVG."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """What its title is filled with, such as the model and the sequence."""
    findings: tuple[Finding, ...] = ()
    """What it shows here."""
    on_page: bool = True
    """Whether the HTML page shows it too; the markdown report shows all."""


@dataclass(frozen=True)
class Section:
    """One part of a study's report."""

    name: str
    """Its anchor, such as campus-10m-turned."""
    kind: str
    """Its key in templates/words.yaml: title, question and remarks."""
    part: str
    """Where the page shows it: setup, results, figures or studies."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """What its words are filled with."""
    findings: tuple[Finding, ...] = ()
    """The first is what a reader in a hurry takes away."""
    illustrations: tuple[Illustration, ...] = ()
    tables: tuple[Table, ...] = ()
    """The first is shown, the others are folded on the page."""
    folded: bool = True
    """Whether tables behind the first are folded on the page."""
    sources: tuple[str, ...] = ()
    """Paths of the artifacts that its numbers are from."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """What they were computed with."""
