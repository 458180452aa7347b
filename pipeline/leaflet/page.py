"""The report as one HTML file that needs nothing else: no server, no network, no library."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, Self

from pipeline.errors import ArtifactError
from pipeline.leaflet.answer import answer, ranked
from pipeline.leaflet.chapter import Chapter
from pipeline.leaflet.chart import chart
from pipeline.leaflet.markup import Html, anchor, data, inline, join, prose, tag
from pipeline.leaflet.parts import compared, described, drawn
from pipeline.leaflet.sources import Lock, entry, stages
from pipeline.leaflet.told import Told, banner, told
from pipeline.leaflet.wording import MAP, QUESTION
from pipeline.reports.study import Study, folders
from pipeline.reports.wording import DEFINITIONS
from pipeline.studies.expansion import asks_about_the_year

PARTS = ("markup.html", "page.css", "tables.js", "map.js")


@dataclass(frozen=True)
class Leaflet:
    """All that the page tells."""

    chapters: Sequence[Chapter]
    sections: Sequence[Told]
    lock: Lock
    missing: Sequence[str] = ()
    """What is not in the page, a line each."""

    @classmethod
    def gather(cls, artifacts: Path, studies: Mapping[str, Any], cells: str, lock: Path) -> Self:
        """All of the studies of conf/benchmark.yaml that is there, each at the cells asked for, else at its first.

        Raises ArtifactError where nothing is.
        """
        chapters, missing = [], list[str]()
        for dataset, words in studies.items():
            if not asks_about_the_year(words):
                missing.append(f"{dataset} asks about viewpoints alone; see {artifacts.name}/viewpoints/{dataset}")
                continue
            try:
                chapters.append(Chapter(_study(artifacts, dataset, words, cells), words, artifacts))
            except ArtifactError as error:
                missing.append(str(error))
        sections = list(told(artifacts, studies, missing))
        if not chapters and not sections:
            raise ArtifactError(f"{artifacts}: nothing to tell of yet; `dvc repro` builds the studies")
        return cls(chapters, sections, Lock.read(lock), missing)

    def html(self) -> str:
        """The whole file."""
        missing, parts = list(self.missing), {name: _part(name) for name in PARTS}
        chapters, models = self.chapters, {one.study.dataset: one.models for one in self.chapters}
        pages = {
            "answer": join([*self._banner(), *(tag("p", inline(answer(one.study)), class_="answer") for one in chapters)]),
            "question": prose(QUESTION),
            "setup": join(described(one) for one in chapters),
            "results": join(compared(one) for one in chapters),
            "figures": join(drawn(one, missing) for one in chapters),
            "sections": join(one.html(models.get(one.dataset, {}), missing) for one in self.sections),
            "map": self._map(),
            "words": self._words(),
            "sources": self._appendix(),
        }
        charts = [data(f"chart-{one.name}", chart(one.study, one.artifacts, ranked(one.study)[0])) for one in chapters]
        options = join(tag("option", one.title, value=f"chart-{one.name}") for one in chapters)
        left = tag("ul", *(tag("li", inline(line)) for line in missing)) if missing else tag("p", "Nothing is missing.")
        contents = join(tag("li", tag("a", one.section.title, href=f"#{anchor(one.section.name)}")) for one in self.sections)
        filled = {
            **pages,
            "charts": join(charts),
            "studies": options,
            "missing": left,
            "contents": tag("ul", contents) if contents else "",
            "css": parts["page.css"],
            "js": parts["tables.js"] + parts["map.js"],
        }
        page = Template(parts["markup.html"])
        size = len(page.safe_substitute(filled, megabytes="").encode()) / 1e6
        return page.substitute(filled, megabytes=f"{size:.1f}")

    def _banner(self) -> list[Html]:
        return [banner()] if any(one.study.simulated for one in self.chapters) else []

    def _map(self) -> Html:
        return prose(MAP) if self.chapters else tag("p", "No study is there to show.")

    def _words(self) -> Html:
        return prose(DEFINITIONS.format(**vars(self.chapters[0].study.bootstrap))) if self.chapters else Html("")

    def _appendix(self) -> Html:
        listed: dict[str, list[Html]] = {}
        for one in self.chapters:
            listed |= {path: more for path, more in one.appendix() if path not in listed}
        more = [path for one in self.sections for path in one.section.sources]
        more += [one.drawn for one in self.chapters]
        listed |= {path: [] for path in more if path not in listed}
        names = dict.fromkeys(name for path in listed if (name := self.lock.of(path)[1]))
        folds = [tag("h3", "Parameters of the stages"), stages(names, self.lock)] if names else []
        shown = tag("ul", *(entry(path, self.lock, *said) for path, said in listed.items()), class_="sources")
        return join([tag("h3", "Artifacts"), shown, *folds])


def _part(name: str) -> str:
    return files("pipeline.leaflet").joinpath(name).read_text(encoding="utf-8")


def _study(artifacts: Path, dataset: str, words: Mapping[str, Any], cells: str) -> Study:
    grid = cells if cells in words["grids"] else words["grids"][0]
    views = {method["name"]: method["view"] for method in words["methods"]}
    find = folders(artifacts, dataset, grid, views)
    return Study.gather(find, dataset, grid, words["train"], words["tests"], list(views), words["heeds"] == "simulated")
