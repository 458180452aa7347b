"""A section of a report: a question, findings, figures, tables, and sources of the numbers.

Templates write its words.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.report.findings import Finding
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
    part: str = "studies"  # where the page shows it: answer, setup, results, figures or studies
    values: Mapping[str, Any] = field(default_factory=dict)  # what its words are filled with
    findings: Sequence[Finding] = ()  # the first is what a reader in a hurry takes away
    illustrations: Sequence[Illustration] = ()
    tables: Sequence[Table] = ()
    folded: bool = True  # whether the page folds all tables but the first
    sources: Sequence[str] = ()  # paths of the artifacts that its numbers are from
    parameters: Mapping[str, Any] = field(default_factory=dict)  # what they were computed with
