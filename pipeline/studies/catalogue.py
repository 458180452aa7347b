"""What each method is, from its yaml and its module's first paragraph.

Nothing of a method is imported.
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
BRACKET = r" \(([^()]*)\)"


@dataclass(frozen=True)
class Entry:
    """One method as the catalogue describes it."""

    name: str
    """Its file's and its yaml's."""
    description: str
    """The paragraph that its module begins with."""
    view: str
    """What it looks at: a file in conf/view."""
    source: str
    """The paper, in that paragraph's brackets beside sections of docs/METHODS.md;
    empty for none."""


def entries(conf: Path = PROJECT / "conf") -> list[Entry]:
    """Every method of conf/method, by name.

    Raises ConfigError for one whose module is missing or has no docstring.
    """
    methods = []
    for path in sorted((conf / "method").glob("*.yaml")):
        settings = read_yaml(path)
        description, source = _described(str(settings.get("_target_")))
        methods.append(Entry(path.stem, description, str(settings.get("view")), source))
    return methods


def what(target: str) -> str:
    """The description of a method by its class, such as pipeline.methods.sci.Sci.

    Empty where its module is missing.
    """
    with suppress(ConfigError):
        return _described(target)[0]
    return ""


def table(methods: Iterable[Entry]) -> str:
    """The methods as the README's GitHub table, a row a method."""
    rows = [("method", "what it is", "looks at", "source"), (":--", ":--", ":--", ":--")]
    rows += [
        (f"`{method.name}`", method.description, f"`{method.view}`", method.source or "–")
        for method in methods
    ]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


def listing(methods: Iterable[Entry], width: int) -> str:
    """The methods as a paragraph each, for a terminal of few columns."""
    paragraphs = (
        f"{method.name}: {method.description}; looks at {method.view}; "
        f"{method.source or 'no source'}"
        for method in methods
    )
    return "".join(
        f"{textwrap.fill(paragraph, max(width, 20), subsequent_indent='  ')}\n"
        for paragraph in paragraphs
    )


def _described(target: str) -> tuple[str, str]:
    """The description of a method and its sources; raises ConfigError as `entries` does."""
    path = PROJECT.joinpath(*target.split(".")[:-1]).with_suffix(".py")
    if not path.is_file():
        raise ConfigError(f"{target}: no {path}, which its yaml names")
    first_paragraph = " ".join(
        (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "")
        .partition("\n\n")[0]
        .split()
    ).rstrip(".")
    if not first_paragraph:
        raise ConfigError(
            f"{path}: expected a docstring whose first paragraph says what the method is"
        )
    cited = [
        citation.strip()
        for bracket in re.findall(BRACKET, first_paragraph)
        for citation in bracket.split(";")
    ]
    return re.sub(BRACKET, "", first_paragraph), "; ".join(
        citation for citation in cited if not citation.startswith("METHODS")
    )
