"""Text that is read and printed, whatever the locale says.

Files are UTF-8, and a terminal that lacks a character shows a ?.
"""

import io
import re
import sys
import textwrap
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

import yaml

from pipeline.core.errors import ConfigError

LOADER: Any = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # in C ten times as fast, where it was built
WRITTEN = ("studies.yaml", "lists.yaml")
"""Of conf/, what `yearloc use` writes."""


def print_anywhere() -> None:
    """From here on, print characters that the terminal's encoding lacks as a ?."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def one_line(message: object) -> str:
    """A message with a ? for line breaks and whatever else a terminal would obey.

    Its words may come from anywhere.
    """
    return "".join(character if character.isprintable() else "?" for character in str(message))


def terminal_width() -> int:
    """The terminal's columns, or what COLUMNS says; without a terminal any line fits."""
    return get_terminal_size((10_000, 1)).columns


def folded(text: str, width: int) -> str:
    """The text in lines of at most `width` columns.

    Of a table, which has a rule of ─ below its header, the columns that are too many go on below,
    beside the first one; other lines wrap. Words and columns that are wider stay whole.
    """
    blocks = []
    for block in text.split("\n\n"):
        lines = block.split("\n")
        rule = next((i for i, line in enumerate(lines) if line and not line.strip("─ ")), 0)
        above, table = (lines[: rule - 1], lines[rule - 1 :]) if rule else (lines, [])
        wrapped_lines = [
            wrapped
            for line in above
            for wrapped in textwrap.wrap(line, width, break_long_words=False) or [""]
        ]
        if max(map(len, table), default=0) <= width:
            blocks.append("\n".join([*wrapped_lines, *table]))
        else:
            blocks.append("\n".join(wrapped_lines + _side_by_side(table, width)))
    return "\n\n".join(blocks)


def _side_by_side(table: list[str], width: int) -> list[str]:
    """A table's lines in parts, each of its first column and as many further ones as fit."""
    table = [line for line in table if line]
    first_column, *other_columns = (rule.span() for rule in re.finditer("─+", table[1]))
    parts: list[list[tuple[int, int]]] = [[]]
    for start, end in other_columns:
        if (
            parts[-1]
            and first_column[1] + sum(2 + e - s for s, e in [*parts[-1], (start, end)]) > width
        ):
            parts.append([])
        parts[-1].append((start, end))
    texts = [
        "\n".join(
            "  ".join(line[s:e].ljust(e - s) for s, e in (first_column, *part)).rstrip()
            for line in table
        )
        for part in parts
    ]
    return "\n\n".join(texts).split("\n")


def read_yaml(path: Path) -> dict[str, Any]:
    """The table in a file of conf/.

    Raises ConfigError where it is missing, empty, no UTF-8, no yaml or no table.
    """
    mend = (
        "`yearloc use campus` writes it anew"
        if path.name in WRITTEN
        else "mend it, or let `git checkout` bring it back"
    )
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), LOADER)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise ConfigError(f"{path}: no such file; {mend}") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else "?"
        raise ConfigError(f"{path}: line {line} is no yaml: {error.problem}; {mend}") from None
    except (UnicodeDecodeError, yaml.YAMLError):
        raise ConfigError(f"{path}: holds bytes that are no text; {mend}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a table of KEY: VALUE; {mend}")
    return content


def check_files(conf: Path) -> None:
    """Raise ConfigError for the first file of conf/ that cannot be read, or of the two lists."""
    for path in sorted({*conf.rglob("*.yaml"), *(conf / name for name in WRITTEN)}):
        read_yaml(path)
