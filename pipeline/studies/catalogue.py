"""What each method is, told from its yaml and its module's first paragraph; nothing of a method is imported."""

import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import yaml

from pipeline.errors import ConfigError

PROJECT = Path(__file__).parents[2]
BRACKET = r" \(([^()]*)\)"
NOTES = "METHODS"
"""What a module cites besides its paper is no source."""


@dataclass(frozen=True)
class Entry:
    """One method."""

    name: str
    """Its file's and its yaml's."""
    what: str
    """The paragraph that its module begins with."""
    view: str
    """What it looks at: a file in conf/view."""
    source: str
    """The paper, in that paragraph's brackets; empty for none."""


def entries(conf: Path = PROJECT / "conf") -> list[Entry]:
    """Every method of conf/method, by name; raises ConfigError for one whose module is not there or tells nothing."""
    found = []
    for path in sorted((conf / "method").glob("*.yaml")):
        settings = yaml.safe_load(path.read_text())
        found.append(Entry(path.stem, *_described(str(settings["_target_"]), settings["view"])))
    return found


def what(target: str) -> str:
    """What the method of a class such as pipeline.methods.sci.Sci is; empty where its module is not there."""
    try:
        return _described(target, "")[0]
    except ConfigError:
        return ""


def table(found: Iterable[Entry]) -> str:
    """The README's: a GitHub table, a row a method."""
    rows = [("method", "what it is", "looks at", "source"), (":--", ":--", ":--", ":--")]
    rows += [(f"`{one.name}`", one.what, f"`{one.view}`", one.source or "–") for one in found]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


def _described(target: str, view: str) -> tuple[str, str, str]:
    path = PROJECT.joinpath(*target.split(".")[:-1]).with_suffix(".py")
    if not path.is_file():
        raise ConfigError(f"{target}: no {path}, which its yaml names")
    told = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n\n")[0].split()).rstrip(".")
    if not told:
        raise ConfigError(f"{path}: expected a docstring whose first paragraph says what the method is")
    cited = [one.strip() for bracket in re.findall(BRACKET, told) for one in bracket.split(";")]
    return re.sub(BRACKET, "", told), view, "; ".join(one for one in cited if not one.startswith(NOTES))
