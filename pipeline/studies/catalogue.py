"""What each method is, from its yaml and its module's first paragraph; nothing of a method is
imported."""

import ast
import re
import textwrap
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import ConfigError
from pipeline.running.texts import read_yaml

PROJECT = Path(__file__).parents[2]
BRACKET = r" \(([^()]*)\)"


@dataclass(frozen=True)
class Entry:
    """One method."""

    name: str  # its file's and its yaml's
    what: str  # the paragraph that its module begins with
    view: str  # what it looks at: a file in conf/view
    # the paper, in that paragraph's brackets beside sections of docs/METHODS.md; empty for none
    source: str


def entries(conf: Path = PROJECT / "conf") -> list[Entry]:
    """Every method of conf/method, by name; raises ConfigError for one whose module is not there or
    tells nothing."""
    found = []
    for path in sorted((conf / "method").glob("*.yaml")):
        settings = read_yaml(path)
        what, source = _described(str(settings.get("_target_")))
        found.append(Entry(path.stem, what, str(settings.get("view")), source))
    return found


def what(target: str) -> str:
    """What the method of a class such as pipeline.methods.sci.Sci is; empty where its module is not
    there."""
    with suppress(ConfigError):
        return _described(target)[0]
    return ""


def table(found: Iterable[Entry]) -> str:
    """The README's: a GitHub table, a row a method."""
    rows = [("method", "what it is", "looks at", "source"), (":--", ":--", ":--", ":--")]
    rows += [(f"`{one.name}`", one.what, f"`{one.view}`", one.source or "–") for one in found]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


def listing(found: Iterable[Entry], width: int) -> str:
    """The same for a terminal of fewer columns than the table's: a paragraph a method."""
    told = (
        f"{one.name}: {one.what}; looks at {one.view}; {one.source or 'no source'}" for one in found
    )
    return "".join(
        f"{textwrap.fill(one, max(width, 20), subsequent_indent='  ')}\n" for one in told
    )


def _described(target: str) -> tuple[str, str]:
    """What a method is, and its source."""
    path = PROJECT.joinpath(*target.split(".")[:-1]).with_suffix(".py")
    if not path.is_file():
        raise ConfigError(f"{target}: no {path}, which its yaml names")
    told = " ".join(
        (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "")
        .partition("\n\n")[0]
        .split()
    ).rstrip(".")
    if not told:
        raise ConfigError(
            f"{path}: expected a docstring whose first paragraph says what the method is"
        )
    cited = [one.strip() for bracket in re.findall(BRACKET, told) for one in bracket.split(";")]
    return re.sub(BRACKET, "", told), "; ".join(
        one for one in cited if not one.startswith("METHODS")
    )
