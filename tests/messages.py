"""Writes the tables of messages in docs/troubleshooting.md: `python -m tests.messages`.

A message is a string of the source, with … for each value that is formatted into it. Its
explanation is written by hand beside it. If a message changed, its row takes the new text. A
message that the source no longer has is removed. An error or warning without a row is listed at the
end of the page.
"""

import ast
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/troubleshooting.md"
FOLDERS = ("pipeline", "stages", "worlds", "benchmarks/papers")
TEMPLATES = ROOT / "pipeline/report/templates/words.yaml"
"""The templates of a report's caveats, which are messages too."""
OTHERS = """
## Other messages

Each says itself what is wrong and what to do.

| message | of |
|---|---|
"""
TABLE = re.compile(
    r"(?P<head>\| message \| what it means, .*\n\|---\|---\|\n)(?P<rows>(?:\|.*\n)+)"
)
ROW = re.compile(r"\| (?P<messages>`.*?`) \| (?P<meaning>.*) \|\n")
CODE = re.compile(r"(`+)(.+?)\1(?!`)")
GAP = "…"
WORD = re.compile(r"[^\W\d_]{2,}")
FEW = 2
"""A text of so few words is a value, not a message to look up."""
SIMILAR = 0.75
"""Least similarity, from 0 to 1, of a changed message and the text that replaces it."""


def plain(node: ast.AST) -> str:
    """A string of the source on one line, with one … for each run of formatted values."""
    text = re.sub(rf"\{{[^{{}}{GAP}]*\}}", GAP, " ".join(_joined(node).split()))
    return re.sub(rf"{GAP}(?:\s?{GAP})+", GAP, text)


def _joined(node: ast.AST) -> str:
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=values):
            return "".join(map(_joined, values))
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return _joined(left) + _joined(right)
    return GAP


def _raised(node: ast.AST) -> Iterator[ast.AST]:
    """The texts of errors that are raised and of warnings, where they are written in place."""
    match node:
        case ast.Raise(exc=ast.Call(args=arguments)):
            yield from arguments
        case ast.Call(func=ast.Attribute(attr="warn" | "warn_if"), args=[*_, text]):
            yield text


def sources() -> dict[str, str]:
    """The source of all modules, by the room that they are in."""
    rooms: dict[str, str] = {}
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        room = ".".join(path.relative_to(ROOT).with_suffix("").parts[:2])
        rooms[room] = rooms.get(room, "") + path.read_text()
    return rooms


def written(page: str, rooms: Mapping[str, str], templates: str = "") -> str:
    """The page with the messages that the rooms and the templates have now."""
    nodes = [(node, room) for room, text in rooms.items() for node in ast.walk(ast.parse(text))]
    texts = {plain(node) for node, _ in nodes if isinstance(node, ast.expr)}
    raised = {plain(text): room for node, room in nodes for text in _raised(node)}
    words = " ".join(templates.split())
    page = page.partition(OTHERS)[0]
    listed = {message for row in ROW.finditer(page) for message in _messages(row)}
    unlisted = {
        text: room
        for text, room in raised.items()
        if text not in listed and len(WORD.findall(text)) > FEW
    }

    def current(message: str) -> str:
        """The present text of a message; empty if the source has no similar one."""
        if message in texts or all(part.strip() in words for part in message.split(GAP)):
            return message
        for text in get_close_matches(message, unlisted, n=1, cutoff=SIMILAR):
            del unlisted[text]
            return text
        return ""

    def row(row: re.Match[str]) -> str:
        codes = [_code(text) for text in map(current, _messages(row)) if text]
        return f"| {'<br>'.join(codes)} | {row['meaning']} |\n" if codes else ""

    page = TABLE.sub(lambda table: table["head"] + ROW.sub(row, table["rows"]), page)
    others = sorted((room, text) for text, room in unlisted.items())
    rows = [f"| {_code(text)} | {room} |\n" for room, text in others]
    return page + OTHERS * bool(rows) + "".join(rows)


def _messages(row: re.Match[str]) -> list[str]:
    return [code.replace("\\|", "|").strip() for _, code in CODE.findall(row["messages"])]


def _code(text: str) -> str:
    """A text as code in a table of Markdown."""
    text = text.replace("|", "\\|")
    return f"`` {text} ``" if "`" in text else f"`{text}`"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(), sources(), TEMPLATES.read_text()))
