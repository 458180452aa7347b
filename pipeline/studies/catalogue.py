"""Lists the methods that can be compared: conf/method in; what each is, and its paper, out.

The description of a method is the first paragraph of its module's docstring. It is read from the
source, so no method is imported, which would load torch.
"""

import ast
import re
import textwrap
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.errors import ConfigError
from pipeline.running.texts import read_yaml

PROJECT = Path(__file__).parents[2]
"""The project's folder."""
BRACKET = r" \(([^()]*)\)"
"""A text in brackets, in which a description cites papers and sections of docs/METHODS.md."""


@dataclass(frozen=True)
class Entry:
    """One method as the catalogue describes it."""

    name: str
    """The name of its file and of its yaml."""
    description: str
    """The paragraph that its module begins with, without what is in brackets."""
    view: str
    """What it looks at: a file in conf/view."""
    source: str
    """The papers that the paragraph cites in brackets; empty if there are none."""


def entries(conf: Path = PROJECT / "conf") -> list[Entry]:
    """Every method of conf/method, sorted by name.

    Raises ConfigError for a method whose module is missing or has no docstring.
    """
    methods = []
    for path in sorted((conf / "method").glob("*.yaml")):
        settings = read_yaml(path)
        description, source = _described(str(settings.get("_target_")))
        methods.append(Entry(path.stem, description, str(settings.get("view")), source))
    return methods


def description_of(target: str) -> str:
    """The description of a method, given by its class, such as pipeline.methods.sci.Sci.

    It is empty if the method's module is missing or has no docstring.
    """
    with suppress(ConfigError):
        description, _ = _described(target)
        return description
    return ""


def table(methods: Iterable[Entry]) -> str:
    """The methods as a markdown table, a row a method; README.md shows it."""
    rows = [("method", "what it is", "looks at", "source"), (":--", ":--", ":--", ":--")]
    for method in methods:
        rows.append(
            (f"`{method.name}`", method.description, f"`{method.view}`", method.source or "–")
        )
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


def listing(methods: Iterable[Entry], width: int) -> str:
    """The methods as a paragraph each, for a terminal of `width` columns."""
    paragraphs = []
    for method in methods:
        source = method.source or "no source"
        text = f"{method.name}: {method.description}; looks at {method.view}; {source}"
        paragraphs.append(textwrap.fill(text, max(width, 20), subsequent_indent="  "))
    return "".join(f"{paragraph}\n" for paragraph in paragraphs)


def _described(target: str) -> tuple[str, str]:
    """The description of a method and its sources; raises ConfigError as `entries` does."""
    *module, _ = target.split(".")  # the last name is the class
    path = PROJECT.joinpath(*module).with_suffix(".py")
    if not path.is_file():
        raise ConfigError(f"{target}: no {path}, which its yaml names")
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first_paragraph = " ".join(docstring.partition("\n\n")[0].split()).rstrip(".")
    if not first_paragraph:
        raise ConfigError(
            f"{path}: expected a docstring whose first paragraph says what the method is"
        )
    papers = []
    for bracket in re.findall(BRACKET, first_paragraph):
        for citation in bracket.split(";"):
            if not citation.strip().startswith("METHODS"):
                papers.append(citation.strip())
    return re.sub(BRACKET, "", first_paragraph), "; ".join(papers)
