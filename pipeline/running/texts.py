"""Reads yaml files and prints text in the same way whatever the locale and the terminal are.

Files are UTF-8; a terminal that lacks a character shows a ?; tables are folded to its width.
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

LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""PyYAML's loader in C, ten times as fast, if PyYAML was built with it."""
WRITTEN = ("studies.yaml", "lists.yaml")
"""The files of conf/ that `yearloc use` writes."""


def print_anywhere() -> None:
    """From now on, print a ? for characters that the terminal's encoding lacks."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def one_line(message: object) -> str:
    """A message with a ? for line breaks and all else that a terminal would obey.

    Parts of a message may come from files and from the network.
    """
    return "".join(character if character.isprintable() else "?" for character in str(message))


def terminal_width() -> int:
    """The terminal's columns, or what COLUMNS says; 10,000 without a terminal, so any line fits."""
    return get_terminal_size((10_000, 1)).columns


def folded(text: str, width: int) -> str:
    """The text in lines of at most `width` columns.

    Text is in blocks with an empty line between them. In a block, a line of ─ is the rule below the
    header of a table: columns of it that do not fit go on below, beside its first column. Lines
    above the header wrap. Words and columns that are wider than `width` stay whole.
    """
    return "\n\n".join(_folded_block(block.split("\n"), width) for block in text.split("\n\n"))


def _folded_block(lines: list[str], width: int) -> str:
    """One block of a text, folded."""
    rule = next((i for i, line in enumerate(lines) if line and not line.strip("─ ")), 0)
    header = rule - 1 if rule else len(lines)
    above = lines[:header]
    table = lines[header:]
    folded_lines = []
    for line in above:
        folded_lines += textwrap.wrap(line, width, break_long_words=False) or [""]
    is_too_wide = max(map(len, table), default=0) > width
    folded_lines += _folded_table(table, width) if is_too_wide else table
    return "\n".join(folded_lines)


def _folded_table(table: list[str], width: int) -> list[str]:
    """A table's lines in parts one below the other, each with the first column."""
    table = [line for line in table if line]
    first_column, *other_columns = (rule.span() for rule in re.finditer("─+", table[1]))
    parts: list[list[tuple[int, int]]] = [[]]  # the columns in each, from where to where
    part_width = first_column[1]
    for start, end in other_columns:
        part_width += 2 + end - start
        if parts[-1] and part_width > width:
            parts.append([])
            part_width = first_column[1] + 2 + end - start
        parts[-1].append((start, end))
    folded_lines: list[str] = []
    for part in parts:
        if folded_lines:
            folded_lines.append("")
        for line in table:
            cells = [line[start:end].ljust(end - start) for start, end in (first_column, *part)]
            folded_lines.append("  ".join(cells).rstrip())
    return folded_lines


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values in a file of conf/.

    Raises ConfigError if it is missing, empty, not UTF-8, no yaml, or has no keys.
    """
    advice = "fix it, or let `git checkout` bring it back"
    if path.name in WRITTEN:
        advice = "`yearloc use campus` rewrites it"
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), LOADER)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise ConfigError(f"{path}: no such file; {advice}") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else "?"
        raise ConfigError(f"{path}: line {line} is no yaml: {error.problem}; {advice}") from None
    except (UnicodeDecodeError, yaml.YAMLError):
        raise ConfigError(f"{path}: holds bytes that are no text; {advice}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a table of KEY: VALUE; {advice}")
    return content


def check_files(conf: Path) -> None:
    """Raise ConfigError for the first yaml file of conf/ that cannot be read.

    The files that `yearloc use` writes must be there too.
    """
    written = (conf / name for name in WRITTEN)
    for path in sorted({*conf.rglob("*.yaml"), *written}):
        read_yaml(path)
