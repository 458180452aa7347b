"""One study as a reader meets it: its question, its answer, figures with how to read each, tables, and where the numbers lie."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from pipeline.errors import ArtifactError
from pipeline.reports.table import Table

FILE = "section.json"


@dataclass(frozen=True)
class Shown:
    """A figure of a section."""

    path: str
    """An SVG, relative to the section's folder."""
    title: str
    read: str
    """How to read it, in a sentence."""
    says: str
    """What it shows here, in an honest sentence."""


@dataclass(frozen=True)
class Section:
    """What a leaf of the chain tells."""

    name: str
    """Such as campus-10m-turned: an anchor in the page."""
    title: str
    question: str
    answer: tuple[str, ...]
    """Findings, in sentences made of the numbers; the first is what a reader in a hurry takes away."""
    simulated: bool
    figures: tuple[Shown, ...] = ()
    tables: tuple[tuple[str, Table], ...] = ()
    """Each with its caption."""
    sources: tuple[str, ...] = ()
    """The artifacts that its numbers are from."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """What they were made with."""

    def write(self, folder: Path) -> None:
        """section.json, for the page, and the same as markdown, beside its figures."""
        (folder / FILE).write_text(json.dumps(asdict(self), indent=1, allow_nan=False, ensure_ascii=False) + "\n")
        (folder / f"{self.name}.md").write_text(self.markdown())

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Raises ArtifactError where the folder holds none."""
        path = folder / FILE
        try:
            told = json.loads(path.read_text())
            figures = tuple(Shown(**one) for one in told.pop("figures"))
            tables = tuple((caption, _table(one)) for caption, one in told.pop("tables"))
            if not isinstance(told["answer"], list):
                raise ValueError("its answer is no list")
            listed = {name: tuple(told[name]) for name in ("answer", "sources")}
            return cls(**{**told, **listed}, figures=figures, tables=tables)
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ArtifactError(f"{path}: no section of a report ({error}); `dvc repro` makes it") from None

    def prose(self) -> str:
        """The answer as markdown: the first finding, and a list of the others."""
        first, *others = self.answer
        return "\n".join([first, *([""] if others else []), *(f"- {finding}" for finding in others)])

    def markdown(self) -> str:
        """The section as a page of its own."""
        shown = [f"### {one.title}\n\n![{one.title}]({one.path})\n\n{one.read} {one.says}\n" for one in self.figures]
        tables = [f"### {caption}\n\n{table.markdown()}" for caption, table in self.tables]
        made = "Simulated data.\n" if self.simulated else ""
        return "\n".join(
            part for part in (f"# {self.title}\n", made, f"{self.question}\n", f"{self.prose()}\n", *shown, *tables) if part
        )


def _table(told: Mapping[str, Any]) -> Table:
    return Table(tuple(told["header"]), tuple(tuple(row) for row in told["rows"]), told["words"])
