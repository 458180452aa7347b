"""The sections that other leaves of the chain tell: found, and put into the page."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import ArtifactError
from pipeline.leaflet.markup import Html, anchor, prose, tag
from pipeline.leaflet.plate import plate
from pipeline.leaflet.sortable import sortable
from pipeline.leaflet.sources import disclosure, place
from pipeline.reports.section import FILE, Section

KINDS = {
    "robustness": "how methods bear turned headings and changed structure",
    "events": "what real events of the world do to the methods",
    "cells": "how the size of a cell matters",
    "ageing": "how methods age",
}
"""A folder on the way to sections, and what they tell, in the page's order."""


@dataclass(frozen=True)
class Told:
    """A section, and where it was found."""

    section: Section
    folder: Path
    dataset: str

    def html(self, models: Mapping[str, str], missing: list[str]) -> Html:
        """Question, answer, figures, tables; `models` says at which path each method's model lies. Adds to `missing`."""
        section, source = self.section, anchor(self.section.name, "source")

        def where(row: Any, heading: str, column: int) -> str:
            return place(models[row[column]]) if row[column] in models else source

        drawn = []
        for one in section.figures:
            try:
                drawn.append(plate(self.folder / one.path, one.title, one.read, one.says))
            except ArtifactError as error:
                missing.append(str(error))
        question = tag("div", prose(section.question), class_="question")
        first, *further = [sortable(table, caption, where) for caption, table in section.tables] or [Html("")]
        folded = [tag("details", tag("summary", "Further tables"), *further)] if further else []
        fold = disclosure(source, section.sources, section.parameters)
        simulated = [banner()] if section.simulated else []
        parts = [tag("h3", section.title), *simulated, question, prose(section.prose()), *drawn, first, *folded, fold]
        return tag("section", *parts, id=anchor(section.name))


def told(artifacts: Path, studies: Mapping[str, Any], missing: list[str]) -> Iterator[Told]:
    """The sections of these studies that are there; those that are not, and damaged ones, are added to `missing`."""
    found: dict[str, list[tuple[Path, str]]] = {kind: [] for kind in KINDS}
    for dataset, words in studies.items():
        for path in sorted(artifacts.glob(f"*/{dataset}/**/{FILE}")):
            parts = path.relative_to(artifacts).parts
            kind = next((kind for kind in KINDS if kind in parts), parts[0])
            if kind != "robustness" or path.parent.name in words.get(
                "robustness", ()
            ):  # else it was told once, and is asked no more
                found.setdefault(kind, []).append((path.parent, dataset))
    missing += [f"no section on {tells}; `make studies` builds it" for kind, tells in KINDS.items() if not found[kind]]
    for folder, dataset in (one for group in found.values() for one in group):
        try:
            yield Told(Section.read(folder), folder, dataset)
        except ArtifactError as error:
            missing.append(str(error))


def banner() -> Html:
    """Stands wherever data are simulated."""
    return tag("p", "Simulated, not recorded data", class_="banner")
