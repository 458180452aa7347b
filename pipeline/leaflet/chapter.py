"""One study in the page: where its artifacts lie, and which of them a number is from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline import store
from pipeline.leaflet.markup import Html, anchor, join, tag
from pipeline.leaflet.sources import definitions, place
from pipeline.leaflet.told import banner
from pipeline.reports.result import dates
from pipeline.reports.study import Study
from pipeline.studies.expansion import models


@dataclass(frozen=True)
class Chapter:
    """A study and where it lies."""

    study: Study
    words: Mapping[str, Any]
    """Of conf/benchmark.yaml."""
    artifacts: Path

    @property
    def name(self) -> str:
        """Such as campus-10m: the beginning of its anchors."""
        return anchor(self.study.dataset, self.study.grid)

    @property
    def title(self) -> str:
        """With what it is made of."""
        return f"{'Simulated ' * self.study.simulated}{self.study.dataset}, cells of {self.study.cell_m:g} m"

    def head(self) -> Html:
        """Its title, over each of its parts."""
        return join([tag("h3", self.title), *([banner()] if self.study.simulated else [])])

    def path(self, kind: str, sequence: str = "", method: str = "") -> str:
        """Of an artifact, as dvc.lock names it."""
        return relative(self.study.find(kind, sequence, method), self.artifacts)

    @property
    def drawn(self) -> str:
        """Where the report left its figures."""
        return relative(self.artifacts / "report" / self.study.dataset / self.study.grid, self.artifacts)

    @cached_property
    def sequences(self) -> list[str]:
        """The test sequences, in the order of their days."""
        return list(dates(self.study.results))

    @cached_property
    def models(self) -> dict[str, str]:
        """Every model's path, those of variants and seeds of a method too, as far as they are there."""
        names = [name for method in self.words["methods"] for name in models(method)]
        there = {name: self.study.find("train", method=name) for name in names}
        return {name: relative(path, self.artifacts) for name, path in there.items() if path.is_file()}

    @property
    def files(self) -> dict[str, Path]:
        """The same, as files."""
        return {name: self.artifacts.parent / path for name, path in self.models.items()}

    @property
    def timed(self) -> Path:
        """Where the latency of its methods is told."""
        return self.artifacts / "latency" / self.study.dataset / self.study.grid

    def where(self, row: Sequence[str], heading: str, column: int) -> str:
        """What a cell of a result table is from: an evaluation, a method's metrics or model, or a sequence's labels."""
        named = {short: full for full, short in dates(self.study.results).items()} | {full: full for full in self.sequences}
        method = next((word for word in (*row, heading) if word in self.study.models), "")
        sequence = next((named[word] for word in row if word in named), "")
        if method and sequence:
            return place(self.path("evaluate", sequence, method))
        if method:
            return place(self.path("metrics" if column else "train", method=method))
        return place(self.path("labels", sequence)) if sequence else ""

    @property
    def made_with(self) -> dict[str, Any]:
        """What all its numbers have in common."""
        study = self.study
        own = {name: self.words[name] for name in ("world", "submap", "budget") if name in self.words}
        given = {
            method: model.recipe["budget"] for method, model in study.models.items() if model.rounds and "budget" in model.recipe
        }
        judged = {"protocol by distance": vars(study.distance), "bootstrap": vars(study.bootstrap)}
        return {"trained on": study.train, "grid": study.grid, **own, "trained with the share": given, **judged}

    def appendix(self) -> list[tuple[str, list[Html]]]:
        """Each artifact's path and what is said of it besides."""
        study, root = self.study, self.words["root"]
        driven = (study.train, *self.sequences)
        listed: list[tuple[str, list[Html]]] = [(f"{root}/{sequence}", []) for sequence in driven]
        listed += [(self.path(kind, sequence), []) for kind in ("submaps", "labels") for sequence in driven]
        for method in study.models:
            views = [self.path("views", sequence, method) for sequence in driven]
            listed += [(path, []) for path in views if path not in dict(listed)]
            listed.append((self.path("metrics", method=method), []))
            listed += [(self.path("evaluate", sequence, method), []) for sequence in self.sequences]
        for path in self.models.values():
            recipe = store.read_recipe(self.artifacts.parent / path)
            told = {name: value for name, value in recipe.items() if not name.startswith("_")}
            listed.append((path, [definitions(told)] if told else []))
        return listed


def relative(path: Path, artifacts: Path) -> str:
    """A path as dvc.lock names it: from the folder that the artifacts lie in."""
    return path.relative_to(artifacts.parent).as_posix()
