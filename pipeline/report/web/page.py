"""The report as one HTML file that needs no server, no network and no other file."""

import json
import re
import zlib
from base64 import b64encode
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import yaml
from markupsafe import Markup

from pipeline.report.render import part, template, words
from pipeline.report.result import by_sequence
from pipeline.report.section import Section, anchor
from pipeline.report.study import Study
from pipeline.report.web.map import chart
from pipeline.running.dvc_files import DvcLock

SCRIPTS = ("page.js", "vendor/d3-zoom.min.js", "map.js")
LISTS = ("conf/studies.yaml", "conf/lists.yaml")  # parameters of every stage, but of no number
SIZE = "@megabytes@"  # stands in the page until its size is known
POINT_PX = 1.2 * 96 / 72  # a figure is shown at 1.2 times its printed size where there is room
# what a data URL in double quotes may hold as it is: less than with base64
UNQUOTED = " !$'()*+,-./:;<=>?@[]^_`{|}~"


@dataclass(frozen=True)
class Picture:
    """A figure as an image of its own, so that its ids do not meet those of other figures."""

    url: Markup
    wide_px: int

    @classmethod
    def of(cls, svg: str) -> "Picture":
        """Build a picture from the text of an SVG file."""
        width = re.search(r'<svg[^>]*?\bwidth="([\d.]+)pt"', svg)
        single_quoted = re.sub(r"=\"([^\"']*)\"", r"='\1'", re.sub(r"\s+", " ", svg))
        url = "data:image/svg+xml," + quote(single_quoted.replace("> <", "><"), safe=UNQUOTED)
        return cls(Markup(url), round(float(width[1]) * POINT_PX) if width else 860)


@dataclass(frozen=True)
class Entry:
    """One study at one cell size on the page."""

    study: Study
    sections: Sequence[Section]
    front: Mapping[str, Any] | None = None  # of a study that asks about the year

    @property
    def id(self) -> str:
        """The HTML id of the study on the page."""
        return anchor(self.study.name, self.study.grid)


def html(entries: Sequence[Entry], lock: DvcLock, stale: Collection[str] = ()) -> str:
    """The whole file, for these studies; it names the figures that could not be read.

    Studies named in `stale` were changed after they were measured.
    """
    lines = list[str]()
    pictures = dict[Path, Picture]()
    sections = [section for entry in entries for section in entry.sections]
    for path in (
        illustration.path
        for section in sections
        for illustration in section.illustrations
        if illustration.on_page
    ):
        try:
            pictures[path] = Picture.of(path.read_text(encoding="utf-8"))
        except OSError:
            lines.append(words("page", "no_figure", path=path))
    fronts = [entry.front for entry in entries if entry.front]
    artifacts = {
        path: (*lock.of(path), recipe)
        for path, recipe in _artifacts([front["study"] for front in fronts], sections).items()
    }
    stages = [
        stage for stage in dict.fromkeys(stage for _, stage, _ in artifacts.values()) if stage
    ]
    page = template(
        "page.html.j2",
        entries=entries,
        fronts=fronts,
        pictures=pictures,
        charts={entry.id: _packed(chart(entry.study)) for entry in entries if entry.front},
        missing=lines,
        stale=stale,
        artifacts=artifacts,
        stages={stage: _yaml(lock.params(stage)) for stage in stages},
        css=Markup(part("page.css")),
        scripts=Markup("\n").join(Markup(part(name)) for name in SCRIPTS),
        megabytes=SIZE,
    )
    return page.replace(SIZE, f"{len(page.encode()) / 1e6:.1f}")


def _artifacts(
    studies: Sequence[Study], sections: Sequence[Section]
) -> dict[str, Mapping[str, str]]:
    """Map the path of each source artifact to the recipe it was trained with; empty if no model."""
    recipes: dict[str, Mapping[str, str]] = {}
    for study in studies:
        driven = (*study.train.split(), *by_sequence(study.results))
        recipes |= {
            study.source(kind, sequence): {}
            for kind in ("submaps", "labels")
            for sequence in driven
        }
        recipes |= {
            study.source("views", sequence, model): {}
            for model in study.models
            for sequence in driven
        }
        recipes |= {
            study.source(kind, result.sequence, result.model): {}
            for result in study.results
            for kind in ("localize", "evaluate")
        }
        for model in (name for name, path in study.trained.items() if path.is_file()):
            parameters = {
                name: value
                for name, value in study.recipe(model).items()
                if not name.startswith("_")
            }
            recipes[study.source("train", model=model)] = parameters
    source_paths = [path for section in sections for path in section.sources]
    return recipes | {path: {} for path in source_paths if path not in recipes}


def _packed(value: Any) -> Markup:
    """The JSON of a value as map.js reads it: a zlib stream in base64."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(b64encode(zlib.compress(text.encode(), 9)).decode())


def _yaml(files: Mapping[str, Any]) -> str:
    stage_files = {file: values for file, values in files.items() if file not in LISTS}
    return yaml.safe_dump(
        stage_files, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
    )
