"""Fills the templates: words.yaml holds titles, captions and sentences, the *.j2 files the markdown report and the page."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from pipeline.report.findings import Finding
from pipeline.report.section import Illustration, Section
from pipeline.report.table import MISSING, Table, fixed, signed

UNIT = re.compile(r"(?<=\d) (?=(?:m|MB|d|days?)\b|%)")
"""A blank that no line breaks at."""
BLANKS = re.compile(r"(?<=\S) {2,}")
"""Left between two parts of a sentence; those that begin a line mean something."""


def part(name: str) -> str:
    """The text of a file in templates/."""
    return files("pipeline.report").joinpath("templates", name).read_text(encoding="utf-8")


def template(name: str, **values: Any) -> str:
    """A filled template."""
    return _environment(name.endswith(".html.j2")).get_template(name).render(**values)


def title(one: Section | Illustration) -> str:
    """Of a section or a figure."""
    return words(_group(one), one.kind, "title", **one.values)


def remark(one: Section | Illustration, name: str) -> str:
    """Another text of a section (`question`, `remarks`) or of a figure (`read`); empty where there is none."""
    return words(_group(one), one.kind, name, **one.values)


def caption(table: Table) -> str:
    """Of a table."""
    return words("tables", table.kind, **table.values)


def sentence(finding: Finding) -> str:
    """A finding in words."""
    return words("findings", finding.kind, **finding.values)


def words(*path: str, **values: Any) -> str:
    """The text at a path of words.yaml, filled; empty where the path ends before a text."""
    found: Any = _words()
    for key in path:
        found = found.get(key, "") if isinstance(found, Mapping) else ""
    return BLANKS.sub(" ", _environment(False).from_string(found).render(**values)).strip() if found else ""


def prose(text: str) -> Markup:
    """The little markdown that the words are written in, as HTML: paragraphs, lists, **strong**, *emphasis* and `code`."""
    blocks = []
    for block in re.split(r"\n\s*\n", text.strip()):
        first, *items = re.split(r"(?m)^- ", block)
        blocks += [Markup("<p>{}</p>").format(inline(first))] if first.strip() else []
        listed = Markup("").join(Markup("<li>{}</li>").format(inline(item)) for item in items)
        blocks += [Markup("<ul>{}</ul>").format(listed)] if items else []
    return Markup("\n").join(blocks)


def inline(text: str) -> Markup:
    """The same within one paragraph."""
    parts = []
    for n, piece in enumerate(str(text).strip().split("`")):
        safe = str(escape(piece))
        if n % 2:
            parts.append(f"<code>{safe}</code>")
        else:
            safe = UNIT.sub("\N{NO-BREAK SPACE}", safe)
            safe = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", safe, flags=re.DOTALL)
            parts.append(re.sub(r"\*(\S.*?)\*", r"<em>\1</em>", safe, flags=re.DOTALL))
    return Markup("".join(parts))


def anchor(*names: str) -> str:
    """An id made of names: what is no letter, digit or dash becomes one."""
    return "-".join(re.sub(r"[^0-9A-Za-z]+", "-", name).strip("-") for name in names if name)


def listing(names: Sequence[str], last: str = "and") -> str:
    """`a`, `b` and `c`."""
    quoted = [f"`{name}`" for name in names]
    return f" {last} ".join(filter(None, (", ".join(quoted[:-1]), *quoted[-1:])))


def percent(share: float, digits: int = 0) -> str:
    """`63 %`; a dash for NaN."""
    return f"{100 * share:.{digits}f}".removesuffix(".0") + " %" if np.isfinite(share) else MISSING


def _group(one: Section | Illustration) -> str:
    return "sections" if isinstance(one, Section) else "figures"


@cache
def _words() -> Mapping[str, Any]:
    found: Mapping[str, Any] = yaml.safe_load(part("words.yaml"))
    return found


class _Filled(Environment):
    """`one.clear` is the entry of a mapping that has one, not the method that empties it."""

    def getattr(self, obj: Any, attribute: str) -> Any:
        return obj[attribute] if isinstance(obj, Mapping) and attribute in obj else super().getattr(obj, attribute)


@cache
def _environment(html: bool) -> Environment:
    env = _Filled(
        loader=PackageLoader("pipeline.report"),
        autoescape=html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    env.filters |= {"fixed": fixed, "signed": signed, "listing": listing, "percent": percent}
    env.filters |= {"prose": prose, "inline": inline, "sentence": sentence, "caption": caption, "title": title, "remark": remark}
    env.globals |= {"anchor": anchor, "words": words}
    return env
