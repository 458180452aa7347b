"""The report as one HTML file that needs no server, no network and no other file.

In: the sections of each study, the data of its map, and what dvc.lock says of the artifacts that
the numbers are from. Out: the text of templates/page.html.j2, with scripts and figures inside.
"""

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
from pipeline.report.study import StudyResults
from pipeline.report.web.map import chart
from pipeline.running.dvc_files import DvcLock

SCRIPTS = ("page.js", "vendor/d3-zoom.min.js", "map.js")
LISTS = ("conf/studies.yaml", "conf/lists.yaml")  # files that every stage depends on, but no number
SIZE = "@megabytes@"  # stands in the page until its size is known
POINT_PX = 1.2 * 96 / 72  # a figure is shown at 1.2 times its printed size where there is room
# What a data URL in double quotes may hold as it is, which takes less room than base64.
UNQUOTED = " !$'()*+,-./:;<=>?@[]^_`{|}~"


@dataclass(frozen=True)
class Picture:
    """A figure as an image of its own, so that its ids do not clash with those of other figures."""

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

    study: StudyResults
    sections: Sequence[Section]
    front: Mapping[str, Any] | None = None  # its first screen, if it tests over days

    @property
    def id(self) -> str:
        """The HTML id of the study on the page."""
        return anchor(self.study.name, self.study.grid)


def html(entries: Sequence[Entry], lock: DvcLock, stale: Collection[str] = ()) -> str:
    """The whole file, for these studies; it names the figures that could not be read.

    Studies named in `stale` were changed after they were measured.
    """
    missing = list[str]()
    pictures = dict[Path, Picture]()
    sections = [section for entry in entries for section in entry.sections]
    illustrations = [figure for section in sections for figure in section.illustrations]
    for path in (figure.path for figure in illustrations if figure.on_page):
        try:
            pictures[path] = Picture.of(path.read_text(encoding="utf-8"))
        except OSError:
            missing.append(words("page", "no_figure", path=path))
    fronts = [entry.front for entry in entries if entry.front]
    recipes = _artifacts([front["study"] for front in fronts], sections)
    artifacts = {path: (*lock.of(path), recipe) for path, recipe in recipes.items()}
    stages = dict.fromkeys(stage for _, stage, _ in artifacts.values() if stage)
    page = template(
        "page.html.j2",
        entries=entries,
        fronts=fronts,
        pictures=pictures,
        charts={entry.id: _packed(chart(entry.study)) for entry in entries if entry.front},
        missing=missing,
        stale=stale,
        artifacts=artifacts,
        stages={stage: _yaml(lock.params(stage)) for stage in stages},
        css=Markup(part("page.css")),
        scripts=Markup("\n").join(Markup(part(name)) for name in SCRIPTS),
        megabytes=SIZE,
    )
    return page.replace(SIZE, f"{len(page.encode()) / 1e6:.1f}")


def _artifacts(
    studies: Sequence[StudyResults], sections: Sequence[Section]
) -> dict[str, Mapping[str, str]]:
    """Map the path of each source artifact to the recipe it was trained with; empty if no model."""
    paths: list[str] = []
    recipes: dict[str, Mapping[str, str]] = {}
    for study in studies:
        driven = (*study.train.split(), *by_sequence(study.results))
        paths += [study.source(kind, day) for kind in ("submaps", "labels") for day in driven]
        paths += [study.source("views", day, model) for model in study.models for day in driven]
        for result in study.results:
            for kind in ("localize", "evaluate"):
                paths.append(study.source(kind, result.sequence, result.model))
        for model in (name for name, path in study.trained.items() if path.is_file()):
            path = study.source("train", model=model)
            paths.append(path)
            recipe = study.recipe(model)
            recipes[path] = {k: value for k, value in recipe.items() if not k.startswith("_")}
    for section in sections:
        paths += section.sources
    return {path: recipes.get(path, {}) for path in dict.fromkeys(paths)}


def _packed(value: Any) -> Markup:
    """The JSON of a value as map.js reads it: a zlib stream in base64."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(b64encode(zlib.compress(text.encode(), 9)).decode())


def _yaml(files: Mapping[str, Any]) -> str:
    """The parameters of a stage as YAML, by the file that sets them."""
    stage_files = {file: values for file, values in files.items() if file not in LISTS}
    return yaml.safe_dump(
        stage_files, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110
    )
