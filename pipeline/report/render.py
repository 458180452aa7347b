"""Fills the templates of the report.

In: sections, findings and tables, which are data. Out: text. words.yaml holds titles, captions and
sentences by kind; the *.j2 files are the report, the page and the document of all results. The
functions below are filters in both.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup, escape

from pipeline.report.findings import Finding
from pipeline.report.result import Scores, day
from pipeline.report.section import Illustration, Section, anchor
from pipeline.report.table import MISSING, Table, fixed, signed

UNIT = re.compile(r"(?<=\d) (?=(?:m|MB|d|days?)\b|%)")  # a blank at which no line may break
# Several blanks between two parts of a sentence, which become one. Those that begin a line stay:
# they mean something in markdown.
BLANKS = re.compile(r"(?<=\S) {2,}")


def part(name: str) -> str:
    """The text of a file in templates/."""
    return files("pipeline.report").joinpath("templates", name).read_text(encoding="utf-8")


def template(name: str, **values: Any) -> str:
    """Fill a template of templates/ with values."""
    return _environment(name.endswith(".html.j2")).get_template(name).render(**values)


def texts(piece: Section | Illustration) -> tuple[str, str, str]:
    """Title, question and remarks of a section; title, "" and how to read it of a figure."""
    if isinstance(piece, Section):
        lines = words("sections", piece.kind, **piece.values)
        title, question, remarks = f"{lines}\n\n".split("\n", 2)
        return title, question, remarks.strip()
    title, _, read = words("figures", piece.kind, **piece.values).partition("\n")
    return title, "", " ".join(read.split())


def title(piece: Section | Illustration) -> str:
    """The title of a section or a figure."""
    return texts(piece)[0]


def caption(table: Table) -> str:
    """The caption of a table."""
    return words("tables", table.kind, **table.values)


def sentence(finding: Finding) -> str:
    """The sentence of a finding."""
    return words("findings", finding.kind, **finding.values)


def words(*path: str, **values: Any) -> str:
    """The text at a path of words.yaml, filled; empty where there is no text."""
    entry: Any = _words()
    for key in path:
        entry = entry.get(key, "") if isinstance(entry, Mapping) else ""
    return filled(entry, **values) if entry else ""


def filled(text: str, /, **values: Any) -> str:
    """A text of a yaml of templates/, filled with values."""
    return BLANKS.sub(" ", _environment(False).from_string(text).render(**values)).strip()


def prose(text: str) -> Markup:
    """Convert the small markdown of words.yaml to HTML.

    Knows paragraphs, lists, **strong**, *emphasis* and `code`.
    """
    return Markup(_markdown().render(text).strip())


def inline(text: str) -> Markup:
    """Convert the markdown within one paragraph to HTML."""
    return Markup(_markdown().renderInline(str(text).strip()))


@cache
def _markdown() -> MarkdownIt:
    markdown = MarkdownIt("zero").enable(["list", "emphasis", "backticks"])

    def unbroken(_: object, tokens: Sequence[Token], place: int, *__: object) -> str:
        return UNIT.sub("\N{NO-BREAK SPACE}", str(escape(tokens[place].content)))

    markdown.add_render_rule("text", unbroken)
    return markdown


def listing(names: Sequence[str]) -> str:
    """Join names in a sentence: `a`, `b` and `c`."""
    quoted = [f"`{name}`" for name in names]
    return " and ".join(filter(None, (", ".join(quoted[:-1]), *quoted[-1:])))


def percent(share: float, digits: int = 0) -> str:
    """A share as percent: `63 %`; a dash for NaN."""
    return f"{100 * share:.{digits}f}".removesuffix(".0") + " %" if np.isfinite(share) else MISSING


class _Numbers(Formatter):
    """Format specs of words.yaml.

    `{mean:3}` and `{difference:+3}` are numbers of three decimals, `{share:%1}` is percent with one
    decimal, `{clear:yes|no}` is a choice.
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        if "|" in format_spec:
            return format_spec.split("|")[0 if value else 1]
        if format_spec[:1] == "%":
            return percent(value, int(format_spec[1:] or 0))
        if format_spec.lstrip("+").isdigit():
            return fixed(value, int(format_spec), "+" if format_spec[0] == "+" else "-")
        return str(super().format_field(value, format_spec))


def from_to(results: Sequence[Scores], name: str) -> str:
    """One number by distance on the first and the last of some test days: `80 % → 60 %`."""
    ends = results if len(results) == 1 else (results[0], results[-1])
    return " → ".join(percent(result.number("distance", name), 1) for result in ends)


def each(items: Iterable[Any], pattern: str, between: str = ", ") -> str:
    """Fill a pattern with each item, a mapping or a sequence, and join the texts.

    See `_Numbers` for what a pattern may hold.
    """
    filled_texts = (
        _Numbers().vformat(pattern, (), item)
        if isinstance(item, Mapping)
        else _Numbers().format(pattern, *item)
        for item in items
    )
    return between.join(filled_texts)


@cache
def _words() -> Mapping[str, Any]:
    entries: Mapping[str, Any] = yaml.safe_load(part("words.yaml"))
    return entries


class _Filled(Environment):
    """Reads `entry.clear` as the key of a mapping, not as the mapping's method `clear`."""

    def getattr(self, obj: Any, attribute: str) -> Any:
        return (
            obj[attribute]
            if isinstance(obj, Mapping) and attribute in obj
            else super().getattr(obj, attribute)
        )


@cache
def _environment(html: bool) -> Environment:
    env = _Filled(
        loader=PackageLoader("pipeline.report"),
        autoescape=html,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    for function in (
        fixed,
        signed,
        listing,
        percent,
        each,
        from_to,
        prose,
        inline,
        sentence,
        caption,
        title,
        texts,
        day,
    ):
        env.filters[function.__name__] = function
    env.filters |= {
        "g": "{:g}".format,
        "counted": lambda n, noun: f"{n} {noun}" if n == 1 else f"{n} {noun}s",
        "end": lambda loop, between: "." if loop.last else between,
    }
    env.globals |= {"anchor": anchor, "words": words}
    return env
